// What the LEDs of the collimators withstand (LightLimits), and the budget that keeps it channel by channel. Pure. A
// strobe keeps one budget for the requested pulses (planning) and one for the measured pulses (enforcing).
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "common/result.h"
#include "drivers/hal/clock.h"

namespace hord::hal {

// What the LED of one channel withstands. After a pulse of width w it rests for
// max(min_rest, w * (1 / max_duty - 1)), so over any pulse and its rest it is lit for at most max_duty of the time.
struct LightLimits {
    Duration max_on = std::chrono::milliseconds(2);    // above 0
    Duration min_rest = std::chrono::milliseconds(5);  // 0 or more
    double max_duty = 0.2;                             // above 0, at most 1
    bool operator==(const LightLimits&) const = default;

    [[nodiscard]] Duration rest_after(Duration width) const {
        const auto for_duty = static_cast<double>(width.count()) * (1 / max_duty - 1);
        return std::max(min_rest, Duration(static_cast<Duration::rep>(for_duty + 0.5)));
    }
};

class LightBudget {
  public:
    explicit LightBudget(std::vector<LightLimits> limits)
        : limits_(std::move(limits)), rested_(limits_.size(), TimePoint::min()) {}

    // When the rest of all `channels` is over.
    [[nodiscard]] TimePoint rested(std::uint32_t channels) const {
        TimePoint at = TimePoint::min();
        each(channels, [&](std::size_t k) { at = std::max(at, rested_[k]); });
        return at;
    }
    // Fails with invalid_argument (too long for a channel), busy (a channel still rests at `start`).
    [[nodiscard]] Result<void> check(std::uint32_t channels, TimePoint start, Duration width) const {
        Duration longest = Duration::max();
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

    void spend(std::uint32_t channels, TimePoint start, Duration width) {
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
    std::vector<TimePoint> rested_;
};

}  // namespace hord::hal
