// From what a GenICam camera says of a frame, its block id and its own clock, to the sensor's sequence and the
// station's clock.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

#include "drivers/hal/clock.h"

namespace hord::drivers {

// Counts blocks. A step of n means that n - 1 blocks were lost; a repeated id repeats the sequence. A block that comes
// after later ones (its last packet was awaited) gets its own number, which is below theirs.
// Ids of 16 bits go from 65535 to 1, or to 0 where the firmware has shown a block 0. Larger ids do not wrap.
class BlockCounter {
  public:
    static constexpr std::uint64_t kMaxLate = 64;  // blocks; more behind is a wrap

    std::uint32_t sequence_of(std::uint64_t id) {
        if (id == 0) period_ = 65536;
        const std::uint64_t last = last_.value_or(id - 1 - unnumbered_);
        const bool wraps = id <= 65535 && last <= 65535;
        const std::uint64_t ahead = wraps ? (id + period_ - last) % period_ : id - last;
        const std::uint64_t behind = wraps ? period_ - ahead : last - id;
        if (last_ && behind <= kMaxLate) return sequence_ - static_cast<std::uint32_t>(behind);
        sequence_ += static_cast<std::uint32_t>(ahead);
        last_ = id;
        unnumbered_ = 0;
        return sequence_;
    }
    // Of a block whose first packet was lost, and with it the id. Blocks end in their order, so it is the next one, or
    // a later one if whole blocks were lost, too.
    std::uint32_t sequence_without_id() { return sequence_ + ++unnumbered_; }

  private:
    std::optional<std::uint64_t> last_;
    std::uint64_t period_ = 65535;
    std::uint32_t sequence_ = 0, unnumbered_ = 0;
};

// The offset of the camera's clock to the station's, as an interval that contains it.
//
// Latched: the camera read its clock between `before` and `after`, so the offset is in [before - value, after - value].
// Later intervals are intersected with earlier ones, which grow by kDrift (both clocks together). Not latched: an
// arrival is an upper bound only, and the least one so far is used. The offset is then too large by the least time from
// the time stamp to the arrival, which nobody knows.
class CameraClock {
  public:
    static constexpr double kDrift = 200e-6;

    void latched(hal::TimePoint before, hal::Duration value, hal::TimePoint after) {
        grow(after);
        const hal::Duration low = before.time_since_epoch() - value, high = after.time_since_epoch() - value;
        const bool meets = low_ && low <= high_ && *low_ <= high;  // else one of the clocks was set
        high_ = meets ? std::min(high_, high) : high;
        low_ = meets ? std::max(*low_, low) : low;
        known_ = true;
    }
    void arrived(hal::Duration value, hal::TimePoint at) {
        if (low_) return;
        grow(at);
        const hal::Duration high = at.time_since_epoch() - value;
        high_ = known_ ? std::min(high_, high) : high;
        known_ = true;
    }

    // After the first latched() or arrived(). Of a clock that was never latched both are the upper bound.
    [[nodiscard]] hal::TimePoint earliest(hal::Duration value) const {
        return hal::TimePoint(low_.value_or(high_) + value);
    }
    [[nodiscard]] hal::TimePoint latest(hal::Duration value) const { return hal::TimePoint(high_ + value); }
    // Half of the interval; none: never latched.
    [[nodiscard]] std::optional<hal::Duration> error() const {
        return low_ ? std::optional((high_ - *low_) / 2) : std::nullopt;
    }

  private:
    void grow(hal::TimePoint now) {
        if (known_) {
            const hal::Duration by(static_cast<std::int64_t>(kDrift * static_cast<double>((now - last_).count())));
            high_ += by;
            if (low_) *low_ -= by;
        }
        last_ = now;
    }

    std::optional<hal::Duration> low_;  // none: not latched
    hal::Duration high_{};
    bool known_ = false;
    hal::TimePoint last_;
};

}  // namespace hord::drivers
