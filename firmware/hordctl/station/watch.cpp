// hordctl watch: shows a running station on a terminal, over Modbus, local or remote.
//
// Each update reads five blocks (STATUS, COUNTERS, HEALTH, PLC, RECIPE) and the new results of the ring. Without an
// answer the error is shown, and the station is asked again.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <deque>
#include <thread>

#include <fmt/format.h>
#include <unistd.h>

#include "common/cli/help_text.h"
#include "firmware/core/faults.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/station/remote.h"
#include "firmware/registers/register_map.h"
#include "firmware/registers/register_snapshot.h"

namespace hord::firmware {
namespace {

constexpr std::size_t kShownResults = 8;
constexpr int kBarWidth = 40, kBesideBar = 24;

struct WatchOptions {
    RemoteOptions remote;
    int every_ms = 500;
    int count = 0;
};

volatile std::sig_atomic_t interrupted = 0;

// Values of one block by their rows' names.
class Rows {
  public:
    Rows(const RegisterSnapshot& station, BlockId block) : station_(station), block_(block) {}
    [[nodiscard]] bool has(const char* row) const { return station_.number(block_, row).has_value(); }
    // 0 and "-" when the station does not know it.
    [[nodiscard]] double number(const char* row) const { return station_.number(block_, row).value_or(0); }
    [[nodiscard]] std::string text(const char* row) const { return station_.text(block_, row); }
    [[nodiscard]] std::string milliseconds(const char* row) const {
        return has(row) ? fmt::format("{:.1f}", number(row) / 1000) : "-";
    }

  private:
    const RegisterSnapshot& station_;
    const BlockId block_;
};

Result<RegisterSnapshot> read_station(modbus::Client& client) {
    RegisterSnapshot station;
    for (const BlockId id : {BlockId::status, BlockId::counters, BlockId::health, BlockId::plc, BlockId::recipe}) {
        auto readings = client.read_block(id);
        if (!readings) return tl::unexpected(readings.error());
        station.set(id, std::move(*readings));
    }
    return station;
}

std::string bar(double share, int width) {
    const int filled = static_cast<int>(std::clamp(share, 0.0, 1.0) * width + 0.5);
    return fmt::format("{:█<{}}{:·<{}}", "", filled, "", width - filled);
}

std::string verdict_row(const Rows& counters, const char* name, int bar_width) {
    const double seen = std::max(counters.number("seen"), 1.0), count = counters.number(name);
    return fmt::format("  {:<8} {:>10.0f}  {}\n", name, count, bar(count / seen, bar_width));
}

// Lines of the newest results, newest first. Each result is read once.
class NewestResults {
  public:
    void follow(modbus::Client& client, std::uint32_t newest) {
        if (newest < newest_) shown_.clear();  // restarted
        std::uint32_t next = std::max(newest_ > newest ? 0 : newest_,
                                      newest > kShownResults ? newest - static_cast<std::uint32_t>(kShownResults) : 0) +
            1;
        for (; next <= newest; ++next) {
            auto readings = client.read_result(next);
            if (!readings) continue;
            RegisterSnapshot one;
            one.set(BlockId::last, std::move(*readings));
            const Rows result(one, BlockId::last);
            const bool bounded = result.text("flags").find("bounded") != std::string::npos;
            shown_.push_front(fmt::format("  {:>8} {:<7} {:<20} score {:>7}  {:>8} ms  reject {}", next,
                                          result.text("verdict"), result.text("reason"),
                                          (bounded ? "<=" : "") + result.text("score"), result.milliseconds("latency"),
                                          result.text("reject_state")));
        }
        newest_ = newest;
        shown_.resize(std::min(shown_.size(), kShownResults));
    }
    [[nodiscard]] const std::deque<std::string>& lines() const { return shown_; }

  private:
    std::uint32_t newest_ = 0;
    std::deque<std::string> shown_;
};

// Ageing of light and optics; "-" until the station has enough parts.
std::string optics(const Rows& health) {
    std::string out = fmt::format("light {} %, dark level {} DN, unevenness {} %, ", health.text("light_output"),
                                  health.has("dark_drift") ? fmt::format("{:+.2f}", health.number("dark_drift")) : "-",
                                  health.text("uneven"));
    if (!health.has("dust")) return out + "dust -";
    const double specks = health.number("dust");
    if (specks == 0) return out + "no dust";
    out += fmt::format("dust at {:.0f} place{}, the largest at lenslet ({}, {})", specks, specks == 1 ? "" : "s",
                       health.text("dust_m"), health.text("dust_n"));
    if (health.has("dust_x"))
        out += fmt::format(", ({:.2f}, {:.2f}) mm", health.number("dust_x"), health.number("dust_y"));
    return out;
}

std::string page(const RemoteOptions& remote, const RegisterSnapshot& station, const NewestResults& results,
                 int columns) {
    const int bar_width = columns == 0 ? kBarWidth : std::clamp(columns - kBesideBar, 10, kBarWidth);
    const Rows status(station, BlockId::status), counters(station, BlockId::counters), health(station, BlockId::health),
        plc(station, BlockId::plc), recipe(station, BlockId::recipe);
    const auto lamp = [&](const char* bit, const char* name) {
        return station.status_bit(bit) ? fmt::format("[{}] ", name) : std::string();
    };
    std::string out = fmt::format("HORD station {}   {}   {}{}{}{}\n\n", remote.modbus, status.text("state"),
                                  lamp("run_permit", "run permit"), lamp("line_stop", "LINE STOP"),
                                  lamp("results_overrun", "RESULTS LOST"), lamp("plc_lost", "PLC LOST"));
    if (const std::uint32_t simulated = station.bits(BlockId::status, "simulated"); simulated != 0)
        out += fmt::format("  SIMULATED: {}\n\n", names_of_faults(simulated));
    out += fmt::format("  {} parts a minute, {:.0f} on the line, {:.0f} seen; recipe {} \"{}\"\n\n",
                       health.text("parts_per_minute"), status.number("parts_on_line"), counters.number("seen"),
                       status.text("recipe"), recipe.text("name"));
    for (const char* name : {"pass", "reject", "unfit"}) out += verdict_row(counters, name, bar_width);
    out += fmt::format("  {:<8} {:>10.0f}  confirmed {:.0f}, failed {:.0f}, late {:.0f}\n\n", "rejected",
                       counters.number("reject_commanded"), counters.number("reject_confirmed"),
                       counters.number("reject_failed"), counters.number("reject_late"));
    out += fmt::format("  latency, ms   p50 {:>7}  p99 {:>7}  max {:>7}\n", health.milliseconds("latency_p50"),
                       health.milliseconds("latency_p99"), health.milliseconds("latency_max"));
    out += fmt::format("  rejection     p50 {:>7}  p99 {:>7}  max {:>7}\n", health.milliseconds("reject_p50"),
                       health.milliseconds("reject_p99"), health.milliseconds("reject_max"));
    out += fmt::format(
        "  PLC: heartbeat {} ms ago, {} results not acknowledged; {:.0f} Modbus connections, {:.0f} requests\n",
        status.text("plc_heartbeat_age"), plc.text("unacknowledged"), health.number("modbus_connections"),
        health.number("modbus_requests"));
    out += fmt::format("  optics: {}\n\n", optics(health));
    const std::uint32_t active = station.bits(BlockId::status, "faults_active"),
                        latched = station.bits(BlockId::status, "faults_latched");
    if ((active | latched) == 0) out += "  no faults\n";
    for (const FaultInfo& fault : kFaultTable) {
        if (((active | latched) & fault.bit) == 0) continue;
        out += fmt::format("  {} {}: {}\n", (active & fault.bit) != 0 ? "FAULT" : "was  ", fault.name, fault.meaning);
        if ((active & fault.bit) != 0) out += fmt::format("        {}\n", fault.cure);
    }
    if (!results.lines().empty()) out += "\n";
    for (const std::string& line : results.lines()) out += line + "\n";
    return out;
}

std::string line(const RegisterSnapshot& station) {
    const Rows counters(station, BlockId::counters), health(station, BlockId::health);
    return fmt::format(
        "{} parts/min {} seen {:.0f} pass {:.0f} reject {:.0f} unfit {:.0f} latency-p99-ms {} light-percent {} dust {} "
        "faults {}\n",
        station.text(BlockId::status, "state"), health.text("parts_per_minute"), counters.number("seen"),
        counters.number("pass"), counters.number("reject"), counters.number("unfit"),
        health.milliseconds("latency_p99"), health.text("light_output"), health.text("dust"),
        names_of_faults(station.bits(BlockId::status, "faults_active")));
}

Exit run_watch(const WatchOptions& options) {
    const bool terminal = ::isatty(STDOUT_FILENO) != 0;
    struct sigaction quit {};
    quit.sa_handler = [](int) { interrupted = 1; };
    ::sigaction(SIGINT, &quit, nullptr);
    auto client = connect(options.remote);
    if (!client) return complain(client.error());
    NewestResults results;
    Exit status = Exit::good;
    for (int k = 0; interrupted == 0 && (options.count == 0 || k < options.count); ++k) {
        if (k > 0) std::this_thread::sleep_for(std::chrono::milliseconds(options.every_ms));  // cut short by SIGINT
        const auto station = read_station(*client);  // connects again when the connection was lost
        status = station ? Exit::good : Exit::bad_input;
        const int columns = terminal_columns(STDOUT_FILENO);  // may change
        std::string out;
        if (station) {
            if (terminal) results.follow(*client, station->bits(BlockId::status, "last_sequence"));
            out = terminal ? wrapped(page(options.remote, *station, results, columns), columns) : line(*station);
        } else {
            out = fmt::format("no answer: {}\n", station.error().message());
        }
        if (terminal) fmt::print("\x1b[H\x1b[2J");
        fmt::print("{}", out);
        std::fflush(stdout);
    }
    return status;
}

}  // namespace

void add_watch(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand(
        "watch", "A running station, live: state, parts a minute, verdicts, latencies, faults with cures");
    auto options = std::make_shared<WatchOptions>();
    add_remote_options(*command, options->remote);
    add_number(*command, "--every", options->every_ms, "Look again after so long, ms", 20, 60000);
    command->add_option("--count", options->count, "Look so many times; 0: until interrupted")
        ->check(in_range(0, 1'000'000))
        ->capture_default_str();
    command->footer(
        "On a terminal a page that renews itself, elsewhere one line a look.\nExample: hordctl watch --modbus "
        "192.168.1.20:502");
    command->callback([options, &status] { status = run_watch(*options); });
}

}  // namespace hord::firmware
