// Kills the station's service with SIGKILL, and says when its lights were dark and its outputs at rest after that: by
// the simulator's side of the lines and by the module's own clock. It aims at one phase of a part's way after the
// other, and strikes at a random moment of it. Everything on the loop's thread.
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

[[nodiscard]] pid_t service_process();  // the service's own; 0: none

// Of the newest part's way; the ejector's is that of some part before it.
enum class Phase : std::uint8_t { belt_runs, edge_seen, light_on, light_was_on, frame_sent, ejector_out };

class Killer {
  public:
    struct Watchers {
        std::function<bool()> ready;  // the station executes
        std::function<void(hal::TimePoint, const std::string&)> say;
        std::function<void()> over;
    };
    // `safe_within` zero: nothing is too late.
    Killer(hal::EventLoop& loop, int kills, hal::Duration safe_within, std::uint64_t seed, Watchers watchers);

    void permit(bool on, hal::TimePoint at);  // the module's output
    void ejector(bool on, hal::TimePoint at);
    void lamps(std::uint32_t lit, hal::TimePoint at);
    void edge() { begins(Phase::edge_seen); }
    void frame() { begins(Phase::frame_sent); }

    // Every kill was made and survived as it should be; and there was one in every phase that was aimed at.
    [[nodiscard]] bool finish();

  private:
    struct Kill {
        hal::TimePoint at;
        Phase phase{};
        bool was_lit = false, was_ejecting = false;
        std::optional<hal::TimePoint> dark, rested, permit_down;
    };
    struct Tally {
        int kills = 0;
        std::vector<hal::Duration> dark, rested, down;  // of those that had a light on, the ejector out; of all
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
