#include "tests/system/rig/killer.h"

#include <algorithm>
#include <array>
#include <csignal>
#include <fstream>
#include <string>
#include <utility>

#include <fmt/format.h>

namespace hord::rig {
namespace {

using namespace std::chrono_literals;
using hal::Duration;
using hal::TimePoint;

constexpr const char* kProcesses = "/sys/fs/cgroup/system.slice/hordd.service/cgroup.procs";
constexpr auto kPatience = 120s;  // for a permit to fall

// The phases to hit, in this order, repeatedly. The kill is at a random moment within the given time from the start of
// the phase. That time is a little shorter than the phase, so that one kill is enough to hit it. The phase of a sent
// frame lasts until the next part's edge; the frame is inspected at its beginning. "The belt runs" is any moment while
// the first parts pass, ends of phases included.
struct Aim {
    Phase at;
    Duration within;
};
constexpr std::array<Aim, 6> kAims = {{{Phase::light_on, 180ms},
                                       {Phase::ejector_out, 760ms},
                                       {Phase::edge_seen, 560ms},
                                       {Phase::light_was_on, 230ms},
                                       {Phase::frame_sent, 800ms},
                                       {Phase::belt_runs, 9s}}};
constexpr std::array<std::pair<Phase, const char*>, 6> kPhases = {{{Phase::belt_runs, "belt empty"},
                                                                   {Phase::edge_seen, "edge seen, light to come"},
                                                                   {Phase::light_on, "light on"},
                                                                   {Phase::light_was_on, "light was on, frame to come"},
                                                                   {Phase::frame_sent, "frame sent, part on its way"},
                                                                   {Phase::ejector_out, "ejector out"}}};
const char* name_of(Phase phase) {
    return std::ranges::find(kPhases, phase, [](const auto& one) { return one.first; })->second;
}

double ms(Duration duration) { return std::chrono::duration<double, std::milli>(duration).count(); }

std::string spread(std::vector<Duration> samples) {
    if (samples.empty()) return "-";
    std::ranges::sort(samples);
    return fmt::format("{:.1f} / {:.1f}", ms(samples[(samples.size() - 1) / 2]), ms(samples.back()));
}

}  // namespace

// Not the whole control group: hord-safe, which sets the safe state afterwards, runs in the same group.
pid_t service_process() {
    std::ifstream processes(kProcesses);
    for (pid_t pid = 0; processes >> pid;) {
        std::ifstream file("/proc/" + std::to_string(pid) + "/cmdline", std::ios::binary);
        std::string program;
        std::getline(file, program, '\0');
        if (program.ends_with("/hordd")) return pid;
    }
    return 0;
}

Killer::Killer(hal::EventLoop& loop, int kills, Duration safe_within, std::uint64_t seed, Watchers watchers)
    : loop_(loop), left_(kills), safe_within_(safe_within), chance_(seed), watchers_(std::move(watchers)) {}

void Killer::begins(Phase phase) {
    if (phase != Phase::ejector_out) phase_ = phase;
    const Aim& aim = kAims[static_cast<std::size_t>(made_) % kAims.size()];
    if (kill_ || drawn_ || !permit_ || left_ == 0 || phase != aim.at) return;
    drawn_ = true;
    timer_ =
        loop_.call_after(Duration(chance_() % static_cast<std::uint64_t>(aim.within.count())), [this] { strike(); });
}

void Killer::strike() {
    drawn_ = false;  // if this kill does not happen, the phase is awaited again
    const pid_t pid = service_process();
    if (kill_ || !permit_ || pid == 0 || !watchers_.ready()) return;
    kill_.emplace();
    kill_->phase = lit_ != 0 ? Phase::light_on : ejects_ ? Phase::ejector_out : phase_;
    kill_->was_lit = lit_ != 0;
    kill_->was_ejecting = ejects_;
    kill_->at = loop_.now();
    if (::kill(pid, SIGKILL) != 0) return kill_.reset();
    timer_ = loop_.call_after(kPatience, [this] { judge(); });
}

void Killer::permit(bool on, TimePoint at) {
    permit_ = on;
    if (on) return begins(Phase::belt_runs);
    if (!kill_) {  // it stopped for another reason
        loop_.cancel(timer_);
        drawn_ = false;
        return;
    }
    if (at < kill_->at || kill_->permit_down) return;
    kill_->permit_down = at;
    loop_.cancel(timer_);
    timer_ = loop_.call_after(300ms, [this] { judge(); });  // later changes of lights and outputs are seen by then
}

void Killer::ejector(bool on, TimePoint at) {
    ejects_ = on;
    if (on) begins(Phase::ejector_out);
    if (!kill_ || at < kill_->at) return;
    if (on) kill_->was_ejecting = true;  // reported after the kill
    else kill_->rested = at;
}

void Killer::lamps(std::uint32_t lit, TimePoint at) {
    const bool was_lit = std::exchange(lit_, lit) != 0;
    if (lit != 0 && !was_lit) begins(Phase::light_on);
    if (lit == 0 && was_lit) begins(Phase::light_was_on);
    if (!kill_ || at < kill_->at) return;
    if (lit != 0)
        kill_->was_lit = true;  // lit before the kill and seen after it; if it lasts, the dead station left a light on
    else kill_->dark = at;
}

void Killer::judge() {
    const Kill kill = *std::exchange(kill_, std::nullopt);
    --left_;
    ++made_;
    const Duration dark = kill.dark ? *kill.dark - kill.at : Duration::zero();
    const Duration rested = kill.rested ? *kill.rested - kill.at : Duration::zero();
    const Duration down = kill.permit_down ? *kill.permit_down - kill.at : Duration::zero();
    bool good = kill.permit_down && lit_ == 0 && !ejects_ && (!kill.was_lit || kill.dark) &&
        (!kill.was_ejecting || kill.rested);
    if (safe_within_ > Duration::zero() && std::max({dark, rested, down}) > safe_within_) good = false;
    Tally& tally = tallies_[kill.phase];
    ++tally.kills;
    if (kill.was_lit) tally.dark.push_back(dark);
    if (kill.was_ejecting) tally.rested.push_back(rested);
    if (kill.permit_down) tally.down.push_back(down);
    if (!good) ++wrong_;
    watchers_.say(
        kill.at,
        fmt::format("kill {}, {}{}: {}{}run permit down {}{}", made_, name_of(kill.phase),
                    kill.was_ejecting && kill.phase != Phase::ejector_out ? ", ejector out" : "",
                    kill.was_lit ? fmt::format("dark after {:.1f} ms, ", ms(dark)) : std::string(),
                    kill.was_ejecting ? fmt::format("ejector at rest after {:.1f} ms, ", ms(rested)) : std::string(),
                    kill.permit_down ? fmt::format("after {:.1f} ms", ms(down)) : std::string("never"),
                    good ? "" : " WRONG"));
    if (left_ == 0) return watchers_.over();
    if (permit_) begins(Phase::belt_runs);  // the station is already back
}

bool Killer::finish() {
    const auto row = [this](const std::string& name, const Tally& tally) {
        watchers_.say(loop_.now(),
                      fmt::format("kills | {} | {} | {} | {} | {} |", name, tally.kills, spread(tally.dark),
                                  spread(tally.rested), spread(tally.down)));
    };
    Tally all;
    bool everywhere = true;
    watchers_.say(loop_.now(),
                  "kills | killed while | kills | lights dark after, p50 / max, ms | ejector at rest after | run "
                  "permit down after |");
    for (const auto& [phase, name] : kPhases) {
        const Tally& tally = tallies_[phase];
        row(name, tally);
        all.kills += tally.kills;
        for (const auto part : {&Tally::dark, &Tally::rested, &Tally::down})
            (all.*part).insert((all.*part).end(), (tally.*part).begin(), (tally.*part).end());
        const auto aim = std::ranges::find(kAims, phase, &Aim::at);
        if (phase != Phase::belt_runs && made_ > aim - kAims.begin() && tally.kills == 0) everywhere = false;
    }
    row("all", all);
    watchers_.say(loop_.now(),
                  fmt::format("kills made {}, wrong {}{}", made_, wrong_,
                              everywhere ? "" : "; a phase that was aimed at was never hit"));
    return left_ == 0 && wrong_ == 0 && everywhere;
}

}  // namespace hord::rig
