// Debounces a light barrier's raw edges into the edges of parts. Lost edges leave a gap in the sequence numbers.
//
// An edge counts when the line was stable for `debounce` after it. It has the time stamp of the first raw edge of its
// bounce burst, so debouncing delays the report and not the time stamp. Pure: no device, no clock.
//
// The kernel reads the level shortly after the interrupt. A single raw edge that shows the unchanged level means that
// both edges of a part were missed. Several raw edges that end at the unchanged level are a spike and report nothing.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include "drivers/gpio/gpio_lines.h"

namespace hord::drivers {

class EdgeFilter {
  public:
    // A level without a matching edge counts only after this time: the edge may still be queued.
    static constexpr hal::Duration kRecheckAfter = std::chrono::milliseconds(20);

    struct Edge {
        bool active = false;
        hal::TimePoint at;
        std::uint32_t sequence = 0;  // from 1; a gap where edges were lost
    };

    // `active` is the line's present level. A bounce burst longer than `max_burst` makes bouncing_too_long() true.
    EdgeFilter(hal::Duration debounce, hal::Duration max_burst, bool active)
        : debounce_(debounce), max_burst_(max_burst), active_(active) {}

    // Raw edges, in order. Appends to `edges` the edge that this one confirms.
    void feed(const GpioEdge& raw, std::vector<Edge>& edges);

    // When settle() is to be called; none: no burst is open.
    [[nodiscard]] std::optional<hal::TimePoint> due() const;

    // Ends a burst that is due at `now`. `active` is the line's level, read after the last raw edge was fed. A level
    // that differs from that of the last edge is accepted if it still differs kRecheckAfter later; without an open
    // burst it then is an edge, and one edge was lost.
    void settle(hal::TimePoint now, bool active, std::vector<Edge>& edges);

    [[nodiscard]] bool bouncing_too_long() const { return burst_ && burst_->last - burst_->first > max_burst_; }

  private:
    struct BounceBurst {
        hal::TimePoint first, last;  // raw edges
        hal::TimePoint due;
        bool rechecking = false;  // the level differed once
        std::uint32_t edges = 0;
        std::uint32_t lost = 0;
        bool active = false;  // after the last edge
    };
    void end_burst(bool active, std::vector<Edge>& edges);
    void append(bool active, hal::TimePoint at, std::uint32_t lost, std::vector<Edge>& edges);

    hal::Duration debounce_, max_burst_;
    bool active_;
    std::optional<BounceBurst> burst_;
    std::optional<hal::TimePoint> unexplained_since_;  // the level differs without an edge
    std::uint32_t sequence_ = 0;
    std::uint32_t lost_since_edge_ = 0;  // the next edge's sequence number skips them
};

// An encoder's counts with their times: the position at a part's edge is needed later, when the edge is confirmed.
class EncoderTrack {
  public:
    static constexpr std::size_t kHistory = 1024;  // counts
    EncoderTrack() : times_(kHistory) {}
    void count(hal::TimePoint at) {
        ++counts_;
        times_[static_cast<std::size_t>(counts_) % kHistory] = at;
    }
    [[nodiscard]] std::int64_t counts() const { return counts_; }
    // The position at `at`; none: before the history.
    [[nodiscard]] std::optional<std::int64_t> counts_at(hal::TimePoint at) const {
        const auto oldest = std::max<std::int64_t>(0, counts_ - static_cast<std::int64_t>(kHistory));
        for (std::int64_t k = counts_; k > oldest; --k) {
            if (times_[static_cast<std::size_t>(k) % kHistory] <= at) return k;
        }
        if (oldest > 0) return std::nullopt;
        return 0;
    }

  private:
    std::vector<hal::TimePoint> times_;  // of count k, at index k modulo kHistory
    std::int64_t counts_ = 0;
};

}  // namespace hord::drivers
