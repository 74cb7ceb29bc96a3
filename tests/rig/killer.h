// Kills the station's service with SIGKILL at random moments, and says when its lights were dark and its outputs at rest after that: by
// the simulator's side of the lines and by the module's own clock. Everything on the loop's thread.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "drivers/hal/event_loop.h"

namespace hord::rig {

[[nodiscard]] pid_t service_process();  // the service's own; 0: none

class Killer {
  public:
    struct Watchers {
        std::function<bool()> ready;                        // the station executes
        std::function<void(hal::TimePoint, const std::string&)> say;
        std::function<void()> over;
    };
    // `safe_within` zero: nothing is too late.
    Killer(hal::EventLoop& loop, int kills, hal::Duration safe_within, std::uint64_t seed, Watchers watchers);

    void permit(bool on, hal::TimePoint at);   // the module's output
    void ejector(bool on, hal::TimePoint at);
    void lamps(std::uint32_t lit, hal::TimePoint at);

    // Every kill was made and survived as it should be.
    [[nodiscard]] bool finish();

  private:
    struct Kill {
        hal::TimePoint at;
        bool was_lit = false, was_ejecting = false, lit_again = false;
        std::optional<hal::TimePoint> dark, rested, permit_down;
    };
    void plan();
    void strike();
    void judge();

    hal::EventLoop& loop_;
    int left_, made_ = 0, lit_ones_ = 0, ejecting_ones_ = 0, wrong_ = 0;
    hal::Duration safe_within_;
    std::mt19937_64 chance_;
    Watchers watchers_;
    hal::EventLoop::TimerId timer_{};
    bool permit_ = false, ejects_ = false;
    std::uint32_t lit_ = 0;
    std::optional<Kill> kill_;
    std::vector<hal::Duration> dark_after_, safe_after_;
};

}  // namespace hord::rig
