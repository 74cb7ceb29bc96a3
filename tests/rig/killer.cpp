#include "tests/rig/killer.h"

#include <csignal>

#include <algorithm>
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

double ms(Duration duration) { return std::chrono::duration<double, std::milli>(duration).count(); }

std::string spread(std::vector<Duration> samples) {
    if (samples.empty()) return "none";
    std::ranges::sort(samples);
    return fmt::format("median {:.1f}, longest {:.1f} ms", ms(samples[samples.size() / 2]), ms(samples.back()));
}

}  // namespace

// What cleans up behind it (hord-safe) is in the same group.
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

// Two seconds from part to part: every moment of one is as likely.
void Killer::plan() { timer_ = loop_.call_after(1s + std::chrono::microseconds(chance_() % 4'000'000), [this] { strike(); }); }

void Killer::strike() {
    const pid_t pid = service_process();
    if (kill_ || !permit_) return;
    if (pid == 0 || !watchers_.ready()) return plan();
    kill_.emplace();
    kill_->was_lit = lit_ != 0;
    kill_->was_ejecting = ejects_;
    kill_->at = loop_.now();
    if (::kill(pid, SIGKILL) != 0) {
        kill_.reset();
        return plan();
    }
    timer_ = loop_.call_after(kPatience, [this] { judge(); });
}

void Killer::permit(bool on, TimePoint at) {
    permit_ = on;
    if (on && !kill_ && left_ > 0) {
        loop_.cancel(timer_);
        return plan();
    }
    if (on || !kill_ || at < kill_->at || kill_->permit_down) return;
    kill_->permit_down = at;
    loop_.cancel(timer_);
    timer_ = loop_.call_after(300ms, [this] { judge(); });  // what else comes of it is seen by then
}

void Killer::ejector(bool on, TimePoint at) {
    ejects_ = on;
    if (kill_ && !on && at >= kill_->at && !kill_->rested) kill_->rested = at;
}

void Killer::lamps(std::uint32_t lit, TimePoint at) {
    lit_ = lit;
    if (!kill_ || at < kill_->at) return;
    if (lit != 0) kill_->was_lit = kill_->lit_again = true;  // on before the kill but seen after it, or, if it lasts, a light of a dead station
    else kill_->dark = at;
}

void Killer::judge() {
    const Kill kill = *std::exchange(kill_, std::nullopt);
    --left_;
    ++made_;
    const Duration dark = kill.dark ? *kill.dark - kill.at : Duration::zero();
    const Duration rested = kill.rested ? *kill.rested - kill.at : Duration::zero();
    const Duration down = kill.permit_down ? *kill.permit_down - kill.at : Duration::zero();
    bool good = kill.permit_down.has_value() && lit_ == 0 && !ejects_ && (!kill.was_ejecting || kill.rested);
    const Duration safe = std::max({dark, rested, down});
    if (safe_within_ > Duration::zero() && safe > safe_within_) good = false;
    if (kill.was_lit) {
        ++lit_ones_;
        dark_after_.push_back(dark);
    }
    if (kill.was_ejecting) ++ejecting_ones_;
    if (kill.permit_down) safe_after_.push_back(std::max(rested, down));
    if (!good) ++wrong_;
    watchers_.say(kill.at, fmt::format("kill {}{}{}: dark after {:.1f} ms, ejector at rest after {:.1f} ms, run permit down {}{}", made_, kill.was_lit ? " while lit" : "",
                                       kill.was_ejecting ? " while ejecting" : "", ms(dark), ms(rested),
                                       kill.permit_down ? fmt::format("after {:.1f} ms", ms(down)) : std::string("never"), good ? "" : " WRONG"));
    if (left_ == 0) return watchers_.over();
    if (permit_) plan();  // it came back already
}

bool Killer::finish() {
    watchers_.say(loop_.now(), fmt::format("kills {} (lit {}, ejecting {}), wrong {}; dark: {}; outputs at rest: {}", made_, lit_ones_, ejecting_ones_, wrong_, spread(dark_after_),
                                           spread(safe_after_)));
    return left_ == 0 && wrong_ == 0;
}

}  // namespace hord::rig
