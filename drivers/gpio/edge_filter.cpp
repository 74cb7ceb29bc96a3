#include "drivers/gpio/edge_filter.h"

#include <utility>

namespace hord::drivers {

void EdgeFilter::feed(const GpioEdge& raw, std::vector<Edge>& edges) {
    if (burst_ && raw.at - burst_->last >= debounce_) end_burst(burst_->active, edges);
    if (!burst_) {
        burst_ = BounceBurst{};
        burst_->first = raw.at;
    }
    unexplained_since_.reset();
    burst_->last = raw.at;
    burst_->due = raw.at + debounce_;
    burst_->rechecking = false;
    burst_->active = raw.active;
    burst_->lost += raw.lost;
    ++burst_->edges;
}

std::optional<hal::TimePoint> EdgeFilter::due() const {
    if (!burst_) return std::nullopt;
    return burst_->due;
}

void EdgeFilter::settle(hal::TimePoint now, bool active, std::vector<Edge>& edges) {
    if (burst_) {
        if (now < burst_->due) return;
        if (active != burst_->active && !burst_->rechecking) {
            burst_->rechecking = true;
            burst_->due = now + kRecheckAfter;
            return;
        }
        end_burst(active, edges);
    } else if (active == active_) {
        unexplained_since_.reset();
    } else if (!unexplained_since_) {
        unexplained_since_ = now;
    } else if (now - *unexplained_since_ >= kRecheckAfter) {
        unexplained_since_.reset();
        append(active, now, 1, edges);
    }
}

void EdgeFilter::end_burst(bool active, std::vector<Edge>& edges) {
    const BounceBurst burst = *std::exchange(burst_, std::nullopt);
    if (active != active_) {
        append(active, burst.first, burst.lost, edges);
        return;
    }
    const bool part_missed = burst.edges == 1;
    lost_since_edge_ += burst.lost + (part_missed ? 2 : 0);
}

void EdgeFilter::append(bool active, hal::TimePoint at, std::uint32_t lost, std::vector<Edge>& edges) {
    active_ = active;
    sequence_ += std::exchange(lost_since_edge_, 0U) + lost + 1;
    edges.push_back({active, at, sequence_});
}

}  // namespace hord::drivers
