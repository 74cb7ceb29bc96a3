// What a collimator's LED stands, a channel: the longest pulse, the shortest rest, and the share of time it may be lit.
//
// After a pulse of width w the light rests for max(min_rest, w * (1 / max_duty - 1)): over any pulse and the rest that
// follows it, and so over any longer time, it is lit for at most max_duty. Pure: told of pulses as they were asked for
// it plans, told of them as they were it enforces.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "common/result.h"
#include "drivers/hal/clock.h"

namespace hord::drivers {

struct LightLimits {
    hal::Duration max_on = std::chrono::milliseconds(2);
    hal::Duration min_rest = std::chrono::milliseconds(5);
    double max_duty = 0.2;  // above 0, at most 1
    bool operator==(const LightLimits&) const = default;

    [[nodiscard]] hal::Duration rest_after(hal::Duration width) const {
        const auto for_duty = static_cast<double>(width.count()) * (1 / max_duty - 1);
        return std::max(min_rest, hal::Duration(static_cast<hal::Duration::rep>(for_duty + 0.5)));
    }
};

class LightBudget {
  public:
    explicit LightBudget(std::vector<LightLimits> limits)
        : limits_(std::move(limits)), rested_(limits_.size(), hal::TimePoint::min()) {}

    // When all of `channels` have rested.
    [[nodiscard]] hal::TimePoint rested(std::uint32_t channels) const {
        hal::TimePoint at = hal::TimePoint::min();
        each(channels, [&](std::size_t k) { at = std::max(at, rested_[k]); });
        return at;
    }
    // The longest pulse that all of `channels` stand.
    [[nodiscard]] hal::Duration max_on(std::uint32_t channels) const {
        hal::Duration longest = hal::Duration::max();
        each(channels, [&](std::size_t k) { longest = std::min(longest, limits_[k].max_on); });
        return longest;
    }

    // Fails with invalid_argument (longer than one of them stands), busy (one has not rested by then).
    [[nodiscard]] Result<void> check(std::uint32_t channels, hal::TimePoint start, hal::Duration width) const {
        if (const hal::Duration longest = max_on(channels); width > longest) {
            return fail(ErrorCode::invalid_argument,
                        "strobe pulse of " + std::to_string(width.count()) + " ns is longer than the " +
                            std::to_string(longest.count()) + " ns that a channel's LED stands",
                        "shorten the pulse, or light other channels");
        }
        if (start < rested(channels)) {
            return fail(ErrorCode::busy,
                        "strobe pulse starts before the light has rested (strobe.min_rest_ms, strobe.max_duty)",
                        "space the parts or shorten the pulse");
        }
        return {};
    }

    void spend(std::uint32_t channels, hal::TimePoint start, hal::Duration width) {
        each(channels,
             [&](std::size_t k) { rested_[k] = std::max(rested_[k], start + width + limits_[k].rest_after(width)); });
    }

  private:
    template <class Do>
    void each(std::uint32_t channels, Do&& act) const {
        for (std::size_t k = 0; k < limits_.size(); ++k) {
            if (((channels >> k) & 1U) != 0) act(k);
        }
    }
    std::vector<LightLimits> limits_;
    std::vector<hal::TimePoint> rested_;
};

}  // namespace hord::drivers
