// The belt: where it is at a time, and when it will be at a place.
//
// Its motion is a chain of stretches of constant speed, drawn ahead from the seed as far as somebody asks. So both
// questions are functions of the seed, not of how often anybody looks; halt() and resume() rewrite only the future.
#pragma once

#include <cstdint>
#include <deque>
#include <vector>

#include "drivers/hal/clock.h"

namespace hord::sim {

struct ConveyorOptions {
    double speed_mm_s = 500;
    double jitter = 0;                                           // share of the speed, uniform: 0.01 is +-1 %
    hal::Duration jitter_every = std::chrono::milliseconds(20);  // how long one speed lasts
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

    // Belt travel since start, mm. `at` not before what forget_before() was told.
    [[nodiscard]] double position_mm(hal::TimePoint at);

    // When the belt reaches a place, rounded up to a whole nanosecond; TimePoint::max() while halted before it.
    [[nodiscard]] hal::TimePoint time_at(double place_mm);

    void halt(hal::TimePoint at);
    void resume(hal::TimePoint at);
    [[nodiscard]] bool halted() const { return halted_; }

    // The past before `at` will not be asked for again.
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
    hal::TimePoint drawn_to_;  // stretches_ hold until here
    double drawn_to_mm_ = 0;
    std::uint64_t drawn_ = 0;  // speeds drawn so far
    std::size_t next_stop_ = 0;
    bool halted_ = false;
};

}  // namespace hord::sim
