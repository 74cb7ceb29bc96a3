// The belt: its position at a time, and the time at which it reaches a position.
//
// The motion is a sequence of stretches of constant speed, drawn from the seed as far as needed. So both answers depend
// on the seed alone, not on earlier calls. halt() and resume() change only the future.
#pragma once

#include <cstdint>
#include <deque>
#include <vector>

#include "drivers/hal/clock.h"

namespace hord::sim {

struct ConveyorOptions {
    double speed_mm_s = 500;
    double jitter = 0;                                           // uniform, relative: 0.01 is +-1 % of the speed
    hal::Duration jitter_every = std::chrono::milliseconds(20);  // duration of each speed
    struct Stop {
        hal::Duration after{};  // since start
        hal::Duration length{};
    };
    std::vector<Stop> stops;  // in order of time, not overlapping
};

class Conveyor {
  public:
    // The belt is at 0 mm at `start` and runs.
    Conveyor(const ConveyorOptions& options, std::uint64_t seed, hal::TimePoint start);

    // Belt travel since start, mm. `at` is not before the time given to forget_before().
    [[nodiscard]] double position_mm(hal::TimePoint at);

    // When the belt reaches a position, rounded up to a whole nanosecond; TimePoint::max() while halted before it.
    [[nodiscard]] hal::TimePoint time_at(double place_mm);

    void halt(hal::TimePoint at);
    void resume(hal::TimePoint at);
    [[nodiscard]] bool halted() const { return halted_; }

    // Frees the stretches before `at`.
    void forget_before(hal::TimePoint at);

  private:
    struct Stretch {
        hal::TimePoint from;
        double from_mm;
        double mm_per_ns;
    };
    void draw_next();
    [[nodiscard]] static double place(const Stretch& stretch, hal::TimePoint at) {
        return stretch.from_mm + stretch.mm_per_ns * static_cast<double>((at - stretch.from).count());
    }

    ConveyorOptions options_;
    std::uint64_t seed_;
    hal::TimePoint start_;
    std::deque<Stretch> stretches_;
    hal::TimePoint drawn_to_;  // end of stretches_
    double drawn_to_mm_ = 0;
    std::uint64_t drawn_ = 0;  // speeds drawn so far
    std::size_t next_stop_ = 0;
    bool halted_ = false;
};

}  // namespace hord::sim
