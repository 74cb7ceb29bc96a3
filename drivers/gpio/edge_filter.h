// From a light barrier's raw edges to the edges of parts: bounces are taken out, and what was lost leaves a gap.
//
// An edge counts once the line has kept still for `debounce` after it, and has the time of the first raw edge of that
// bounce_burst: waiting costs delay, not accuracy. Pure: no device, no clock.
//
// The kernel reads the level a little after the interrupt. So one that is answered too late shows a level that never
// was, and an edge that reads as the level before it, all alone, means that the line was somewhere else and nobody saw
// it: the part's two edges are counted as lost. A spike that is over sooner gives its two edges, both of them, and is a
// bounce.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include "drivers/gpio/gpio_lines.h"

namespace hord::drivers {

class EdgeFilter {
  public:
    struct Edge {
        bool active = false;
        hal::TimePoint at;
        std::uint32_t sequence = 0;  // from 1; a gap where edges were lost
    };

    // The line is at `active` now. An bounce_burst longer than `patience` makes it restless().
    EdgeFilter(hal::Duration debounce, hal::Duration patience, bool active)
        : debounce_(debounce), patience_(patience), active_(active) {}

    // Raw edges, in order. Appends to `edges` what became certain before this one.
    void feed(const GpioEdge& raw, std::vector<Edge>& edges);

    // When settle() is due; none: the line is still.
    [[nodiscard]] std::optional<hal::TimePoint> due() const;

    // At `now`, `active` is the line's level, read after the last raw edge was fed. Ends an bounce_burst that is due. A
    // level that no edge has told of may be that of an edge that is still on its way: it is believed the second time,
    // kDoubt later. On a line that is still it is an edge that was lost.
    static constexpr hal::Duration kDoubt = std::chrono::milliseconds(20);
    void settle(hal::TimePoint now, bool active, std::vector<Edge>& edges);

    [[nodiscard]] bool restless() const { return unrest_ && unrest_->last - unrest_->first > patience_; }
    [[nodiscard]] std::uint64_t bounces() const { return bounces_; }  // raw edges that were no part's
    [[nodiscard]] std::uint64_t lost() const { return lost_; }        // edges counted as lost

  private:
    struct BounceBurst {
        hal::TimePoint first, last;
        hal::TimePoint due;
        bool doubted = false;
        std::uint32_t edges = 0;
        std::uint32_t lost = 0;
        bool active = false;  // after the last one
    };
    void end_bounce_burst(bool active, std::vector<Edge>& edges);
    void tell(bool active, hal::TimePoint at, std::uint32_t lost, std::vector<Edge>& edges);

    hal::Duration debounce_, patience_;
    bool active_;
    std::optional<BounceBurst> unrest_;
    std::optional<hal::TimePoint> doubted_since_;  // a still line's level
    std::uint32_t sequence_ = 0;
    std::uint32_t untold_ = 0;  // lost, not yet shown as a gap
    std::uint64_t bounces_ = 0, lost_ = 0;
};

// An encoder's counts, and where it was a moment ago: a part's edge is told later than it happened.
class EncoderTrack {
  public:
    static constexpr std::size_t kRemembered = 1024;
    explicit EncoderTrack() : marks_(kRemembered) {}
    void count(hal::TimePoint at) {
        ++counts_;
        marks_[static_cast<std::size_t>(counts_) % kRemembered] = at;
    }
    [[nodiscard]] std::int64_t counts() const { return counts_; }
    // None: further back than it remembers.
    [[nodiscard]] std::optional<std::int64_t> counts_at(hal::TimePoint at) const {
        const auto oldest = std::max<std::int64_t>(0, counts_ - static_cast<std::int64_t>(kRemembered));
        for (std::int64_t k = counts_; k > oldest; --k) {
            if (marks_[static_cast<std::size_t>(k) % kRemembered] <= at) return k;
        }
        if (oldest > 0) return std::nullopt;
        return 0;
    }

  private:
    std::vector<hal::TimePoint> marks_;  // of count k, at k modulo its size
    std::int64_t counts_ = 0;
};

}  // namespace hord::drivers
