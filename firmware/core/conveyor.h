// Position of the conveyor from encoder readings: linear extrapolation; a standing belt stays where it is.
#pragma once

#include <algorithm>
#include <cstdint>

#include "firmware/core/core_config.h"

namespace hord::firmware {

class Conveyor {
  public:
    static constexpr std::int64_t kPlausible = std::int64_t{1} << 60;
    [[nodiscard]] static bool plausible(std::int64_t counts) { return counts > -kPlausible && counts < kPlausible; }

    // Readings older than the last one, or beyond what an encoder counts in a lifetime, are ignored.
    void read(TimePoint at, std::int64_t counts) {
        if ((known_ && at <= at_) || !plausible(counts)) return;
        if (!known_) {
            base_at_ = at;
            base_counts_ = counts;
        } else if (at - base_at_ >= kBaseline) {
            step_ns_ = (at - base_at_).count();
            step_counts_ = counts - base_counts_;
            base_at_ = at;
            base_counts_ = counts;
        }
        at_ = at;
        counts_ = counts;
        known_ = true;
    }
    void forget() { *this = Conveyor{}; }

    [[nodiscard]] bool known() const { return known_; }
    [[nodiscard]] TimePoint last_read() const { return at_; }
    [[nodiscard]] bool reached(std::int64_t counts) const { return known_ && counts_ >= counts; }

    // When `counts` was or will be reached at the present speed. TimePoint::max(): not within an hour, or the belt
    // stands still.
    [[nodiscard]] TimePoint reaches(std::int64_t counts) const {
        if (!known_) return TimePoint::max();
        const std::int64_t distance = counts - counts_;
        if (step_counts_ <= 0) return distance <= 0 ? at_ : TimePoint::max();
        if (distance / step_counts_ > kFar.count() / step_ns_) return TimePoint::max();
        if (distance / step_counts_ < -(kFar.count() / step_ns_)) return at_ - kFar;
        return at_ + Duration(scaled(distance, step_ns_, step_counts_));
    }
    [[nodiscard]] std::int64_t counts_at(TimePoint t) const {
        const std::int64_t ns = std::clamp((t - at_).count(), -kFar.count(), kFar.count());
        if (step_counts_ <= 0 || ns / step_ns_ > kPlausible / step_counts_) return counts_;
        return counts_ + scaled(ns, step_counts_, step_ns_);
    }

  private:
    static constexpr Duration kFar = std::chrono::hours(1);
    // Shortest interval for the speed: between readings microseconds apart, the counts differ by 0 or 1.
    static constexpr Duration kBaseline = milliseconds(4);

    // value * num / den without leaving 64 bits: |value / den * num| stays below kFar or kPlausible (checked by the
    // callers), and the remainder's product is rounded in double precision.
    [[nodiscard]] static std::int64_t scaled(std::int64_t value, std::int64_t num, std::int64_t den) {
        return value / den * num +
            static_cast<std::int64_t>(static_cast<double>(value % den) * static_cast<double>(num) /
                                      static_cast<double>(den));
    }

    bool known_ = false;
    TimePoint at_, base_at_;
    std::int64_t base_counts_ = 0;
    std::int64_t counts_ = 0;
    std::int64_t step_ns_ = 0;  // at least kBaseline where step_counts_ is above 0
    std::int64_t step_counts_ = 0;
};

}  // namespace hord::firmware
