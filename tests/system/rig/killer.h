// Kills the station's service with SIGKILL and measures the time until its lights are dark and its outputs at rest, on
// the simulator's side of the lines and by the module's own clock. It aims at each phase of a part's way in turn, at a
// random moment of the phase. Loop thread only.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include <sys/types.h>

#include "drivers/hal/event_loop.h"

namespace hord::rig {

[[nodiscard]] pid_t service_process();  // the service's main process; 0: none

// Phases of the newest part; ejector phases belong to an earlier part.
enum class Phase : std::uint8_t { belt_runs, edge_seen, light_on, light_was_on, frame_sent, ejector_out };

struct Kill {
    hal::TimePoint at;
    Phase phase{};
    bool was_lit = false, was_ejecting = false;
    std::optional<hal::TimePoint> dark, rested, permit_down;
};

class Killer {
  public:
    struct Watchers {
        std::function<bool()> ready;  // the station executes
        std::function<void(hal::TimePoint, const std::string&)> say;
        std::function<void()> over;
    };
    // `safe_within` zero: times are reported, not checked.
    Killer(hal::EventLoop& loop, int kills, hal::Duration safe_within, std::uint64_t seed, Watchers watchers);

    void permit(bool on, hal::TimePoint at);  // the module's output
    void ejector(bool on, hal::TimePoint at);
    void lamps(std::uint32_t lit, hal::TimePoint at);
    void edge() { begins(Phase::edge_seen); }
    void frame() { begins(Phase::frame_sent); }

    // True if every kill was made and the station recovered, and each phase aimed at had at least one kill.
    [[nodiscard]] bool finish();

  private:
    struct Tally {
        int kills = 0;
        std::vector<hal::Duration> dark, rested, down;  // of kills with a light on; with the ejector out; of all kills
    };
    void begins(Phase phase);
    void strike();
    void judge();

    hal::EventLoop& loop_;
    int left_, made_ = 0, wrong_ = 0;
    hal::Duration safe_within_;
    std::mt19937_64 chance_;
    Watchers watchers_;
    hal::EventLoop::TimerId timer_{};
    bool permit_ = false, ejects_ = false, drawn_ = false;  // the last: the next moment
    std::uint32_t lit_ = 0;
    Phase phase_ = Phase::belt_runs;
    std::optional<Kill> kill_;
    std::map<Phase, Tally> tallies_;
};

}  // namespace hord::rig
