// Keeps the limits of the collimators' LEDs (LightLimits), channel by channel. Pure. The strobe keeps one for
// the requested pulses (planning) and one for the measured pulses (enforcing).
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "common/result.h"
#include "drivers/gpio/gpio_options.h"
#include "drivers/hal/clock.h"

namespace hord::drivers {

class LightBudget {
  public:
    explicit LightBudget(std::vector<LightLimits> limits)
        : limits_(std::move(limits)), rested_(limits_.size(), hal::TimePoint::min()) {}

    // When the rest of all `channels` is over.
    [[nodiscard]] hal::TimePoint rested(std::uint32_t channels) const {
        hal::TimePoint at = hal::TimePoint::min();
        each(channels, [&](std::size_t k) { at = std::max(at, rested_[k]); });
        return at;
    }
    // Fails with invalid_argument (too long for a channel), busy (a channel still rests at `start`).
    [[nodiscard]] Result<void> check(std::uint32_t channels, hal::TimePoint start, hal::Duration width) const {
        hal::Duration longest = hal::Duration::max();
        each(channels, [&](std::size_t k) { longest = std::min(longest, limits_[k].max_on); });
        if (width > longest) {
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
