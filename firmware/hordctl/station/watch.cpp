// hordctl watch: shows a running station on a terminal, over Modbus, local or remote.
//
// Each update reads five blocks (STATUS, COUNTERS, HEALTH, PLC, RECIPE) and the new results of the ring. Without an
// answer the error is shown, and the station is asked again.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <deque>
#include <map>
#include <thread>

#include <fmt/format.h>
#include <unistd.h>

#include "firmware/core/faults.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/station/remote.h"
#include "firmware/registers/register_map.h"
#include "firmware/registers/register_snapshot.h"

namespace hord::firmware {
namespace {

constexpr std::size_t kShownResults = 8;
constexpr int kBarWidth = 40;

struct WatchOptions {
    RemoteOptions remote;
    int every_ms = 500;
    int count = 0;
};

volatile std::sig_atomic_t interrupted = 0;

// A station's readings by their names alone, without their blocks.
class RowsByName {
  public:
    void add(const std::vector<Reading>& readings) {
        for (const Reading& reading : readings) rows_.insert_or_assign(std::string(reading.what->name), reading);
    }
    [[nodiscard]] bool has(const char* name) const { return find(name) != nullptr && find(name)->number; }
    // 0 and "-" when the station does not know it.
    [[nodiscard]] double number(const char* name) const { return has(name) ? *find(name)->number : 0; }
    [[nodiscard]] std::string text(const char* name) const {
        return find(name) != nullptr ? RegisterSnapshot::plain_text(*find(name)) : "-";
    }
    [[nodiscard]] bool status_bit(const char* name) const {
        return has("bits") && RegisterSnapshot::has_bit(*find("bits"), name);
    }

  private:
    [[nodiscard]] const Reading* find(const char* name) const {
        const auto at = rows_.find(name);
        return at != rows_.end() ? &at->second : nullptr;
    }
    std::map<std::string, Reading> rows_;
};

Result<RowsByName> read_station(modbus::Client& client) {
    RowsByName rows;
    for (const BlockId id :
         // STATUS last: where two blocks have a row of one name, STATUS's is kept.
         {BlockId::counters, BlockId::health, BlockId::plc, BlockId::recipe, BlockId::status}) {
        const auto readings = client.read_block(id);
        if (!readings) return tl::unexpected(readings.error());
        rows.add(*readings);
    }
    return rows;
}

std::string milliseconds_of(const RowsByName& m, const char* name) {
    return m.has(name) ? fmt::format("{:.1f}", m.number(name) / 1000) : "-";
}

std::string bar(double share) {
    const int filled = static_cast<int>(std::clamp(share, 0.0, 1.0) * kBarWidth + 0.5);
    std::string out;
    for (int k = 0; k < kBarWidth; ++k) out += k < filled ? "█" : "·";
    return out;
}

std::string verdict_row(const RowsByName& m, const char* name) {
    const double seen = std::max(m.number("seen"), 1.0);
    return fmt::format("  {:<8} {:>10.0f}  {}\n", name, m.number(name), bar(m.number(name) / seen));
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
            const auto result = client.read_result(next);
            if (!result) continue;
            RowsByName m;
            m.add(*result);
            shown_.push_front(fmt::format("  {:>8} {:<7} {:<20} score {:>7}  {:>8} ms  reject {}", next,
                                          m.text("verdict"), m.text("reason"), m.text("score"),
                                          milliseconds_of(m, "latency"), m.text("reject_state")));
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
std::string optics(const RowsByName& m) {
    std::string out =
        fmt::format("light {} %, dark level {} DN, unevenness {} %, ", m.text("light_output"),
                    m.has("dark_drift") ? fmt::format("{:+.2f}", m.number("dark_drift")) : "-", m.text("uneven"));
    if (!m.has("dust")) return out + "dust -";
    if (m.number("dust") == 0) return out + "no dust";
    out += fmt::format("dust at {:.0f} place{}, the largest at lenslet ({}, {})", m.number("dust"),
                       m.number("dust") == 1 ? "" : "s", m.text("dust_m"), m.text("dust_n"));
    if (m.has("dust_x")) out += fmt::format(", ({:.2f}, {:.2f}) mm", m.number("dust_x"), m.number("dust_y"));
    return out;
}

std::string page(const RemoteOptions& remote, const RowsByName& m, const NewestResults& results) {
    const auto lamp = [&](const char* bit, const char* name) {
        return m.status_bit(bit) ? fmt::format("[{}] ", name) : std::string();
    };
    std::string out = fmt::format("HORD station {}   {}   {}{}{}{}\n\n", remote.modbus, m.text("state"),
                                  lamp("run_permit", "run permit"), lamp("line_stop", "LINE STOP"),
                                  lamp("results_overrun", "RESULTS LOST"), lamp("plc_lost", "PLC LOST"));
    out += fmt::format("  {} parts a minute, {:.0f} on the line, {:.0f} seen; recipe {} \"{}\"\n\n",
                       m.text("parts_per_minute"), m.number("parts_on_line"), m.number("seen"), m.text("recipe"),
                       m.text("name"));
    for (const char* name : {"pass", "reject", "unfit"}) out += verdict_row(m, name);
    out += fmt::format("  {:<8} {:>10.0f}  confirmed {:.0f}, failed {:.0f}, late {:.0f}\n\n", "rejected",
                       m.number("reject_commanded"), m.number("reject_confirmed"), m.number("reject_failed"),
                       m.number("reject_late"));
    out += fmt::format("  latency, ms   p50 {:>7}  p99 {:>7}  max {:>7}\n", milliseconds_of(m, "latency_p50"),
                       milliseconds_of(m, "latency_p99"), milliseconds_of(m, "latency_max"));
    out += fmt::format("  rejection     p50 {:>7}  p99 {:>7}  max {:>7}\n", milliseconds_of(m, "reject_p50"),
                       milliseconds_of(m, "reject_p99"), milliseconds_of(m, "reject_max"));
    out += fmt::format(
        "  PLC: heartbeat {} ms ago, {} results not acknowledged; {:.0f} Modbus connections, {:.0f} requests\n",
        m.text("plc_heartbeat_age"), m.text("unacknowledged"), m.number("modbus_connections"),
        m.number("modbus_requests"));
    out += fmt::format("  optics: {}\n\n", optics(m));
    const auto active = static_cast<std::uint32_t>(m.number("faults_active")),
               latched = static_cast<std::uint32_t>(m.number("faults_latched"));
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

std::string line(const RowsByName& m) {
    return fmt::format(
        "{} parts/min {} seen {:.0f} pass {:.0f} reject {:.0f} unfit {:.0f} latency-p99-ms {} light-percent {} dust {} "
        "faults {}\n",
        m.text("state"), m.text("parts_per_minute"), m.number("seen"), m.number("pass"), m.number("reject"),
        m.number("unfit"), milliseconds_of(m, "latency_p99"), m.text("light_output"), m.text("dust"),
        names_of_faults(static_cast<std::uint32_t>(m.number("faults_active"))));
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
        const auto rows = read_station(*client);  // connects again when the connection was lost
        status = rows ? Exit::good : Exit::bad_input;
        std::string out;
        if (rows) {
            if (terminal) results.follow(*client, static_cast<std::uint32_t>(rows->number("last_sequence")));
            out = terminal ? page(options.remote, *rows, results) : line(*rows);
        } else {
            out = fmt::format("no answer: {}\n", rows.error().message());
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
    command->add_option("--every", options->every_ms, "Look again after so long, ms")
        ->check(CLI::Range(20, 60000))
        ->capture_default_str();
    command->add_option("--count", options->count, "Look so many times; 0: until interrupted")
        ->check(CLI::NonNegativeNumber)
        ->capture_default_str();
    command->footer(
        "On a terminal a page that renews itself, elsewhere one line a look.\nExample: hordctl watch --modbus "
        "192.168.1.20:502");
    command->callback([options, &status] { status = run_watch(*options); });
}

}  // namespace hord::firmware
