// hordctl watch: a station as it lives, on a terminal; over Modbus, local or remote.
//
// Everything comes from five coherent reads (STATUS, COUNTERS, HEALTH, PLC, RECIPE) and the newest results of the ring.
// A station that does not answer is shown as that, and asked again.
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

// One moment of a station, by the names of the register map.
class Moment {
  public:
    void add(const std::vector<Reading>& readings) {
        for (const Reading& reading : readings) rows_.insert_or_assign(std::string(reading.what->name), reading);
    }
    [[nodiscard]] double number(const char* name, double otherwise = 0) const {
        const auto at = rows_.find(name);
        return at != rows_.end() && at->second.number ? *at->second.number : otherwise;
    }
    // "6 Ready" is "Ready" here.
    [[nodiscard]] std::string text(const char* name) const {
        const auto at = rows_.find(name);
        if (at == rows_.end()) return "-";
        const std::string& all = at->second.text;
        const auto space = all.find(' ');
        return at->second.what->type == RegisterType::u16 && !at->second.what->values.empty() &&
                space != std::string::npos
            ? all.substr(space + 1)
            : all;
    }
    [[nodiscard]] bool has(const char* name) const {
        const auto at = rows_.find(name);
        return at != rows_.end() && at->second.number.has_value();
    }

  private:
    std::map<std::string, Reading> rows_;
};

Result<Moment> look(modbus::Client& client) {
    Moment moment;
    for (const BlockId id :
         {BlockId::counters, BlockId::health, BlockId::plc, BlockId::recipe, BlockId::status}) {  // STATUS's names win
        const auto readings = client.read_block(id);
        if (!readings) return tl::unexpected(readings.error());
        moment.add(*readings);
    }
    return moment;
}

std::string milliseconds_of(const Moment& m, const char* name) {
    return m.has(name) ? fmt::format("{:.1f}", m.number(name) / 1000) : "-";
}

std::string bar(double share) {
    const int filled = static_cast<int>(std::clamp(share, 0.0, 1.0) * kBarWidth + 0.5);
    std::string out;
    for (int k = 0; k < kBarWidth; ++k) out += k < filled ? "█" : "·";
    return out;
}

std::string counted(const Moment& m, const char* name) {
    const double seen = std::max(m.number("seen"), 1.0);
    return fmt::format("  {:<8} {:>10.0f}  {}\n", name, m.number(name), bar(m.number(name) / seen));
}

// The newest results, newest first; what was read before is not read again.
class Results {
  public:
    void follow(modbus::Client& client, std::uint32_t newest) {
        if (newest < newest_) shown_.clear();  // restarted
        std::uint32_t next = std::max(newest_ > newest ? 0 : newest_,
                                      newest > kShownResults ? newest - static_cast<std::uint32_t>(kShownResults) : 0) +
            1;
        for (; next <= newest; ++next) {
            const auto result = client.read_result(next);
            if (!result) continue;
            Moment m;
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

// How light and optics age; "-" until enough parts were seen.
std::string optics(const Moment& m) {
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

std::string page(const RemoteOptions& remote, const Moment& m, const Results& results) {
    const auto bits = static_cast<unsigned>(m.number("bits"));
    const auto lamp = [&](unsigned bit, const char* name) {
        return (bits >> bit & 1U) != 0 ? fmt::format("[{}] ", name) : std::string();
    };
    std::string out =
        fmt::format("HORD station {}   {}   {}{}{}{}\n\n", remote.modbus, m.text("state"), lamp(1, "run permit"),
                    lamp(2, "LINE STOP"), lamp(6, "RESULTS LOST"), lamp(7, "PLC LOST"));
    out += fmt::format("  {} parts a minute, {:.0f} on the line, {:.0f} seen; recipe {} \"{}\"\n\n",
                       m.text("parts_per_minute"), m.number("parts_on_line"), m.number("seen"), m.text("recipe"),
                       m.text("name"));
    for (const char* name : {"pass", "reject", "unfit"}) out += counted(m, name);
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

std::string line(const Moment& m) {
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
    Results results;
    Exit status = Exit::good;
    for (int k = 0; interrupted == 0 && (options.count == 0 || k < options.count); ++k) {
        if (k > 0) std::this_thread::sleep_for(std::chrono::milliseconds(options.every_ms));  // cut short by SIGINT
        const auto moment = look(*client);  // connects again when the connection was lost
        status = moment ? Exit::good : Exit::bad_input;
        std::string out;
        if (moment) {
            if (terminal) results.follow(*client, static_cast<std::uint32_t>(moment->number("last_sequence")));
            out = terminal ? page(options.remote, *moment, results) : line(*moment);
        } else {
            out = fmt::format("no answer: {}\n", moment.error().message());
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
