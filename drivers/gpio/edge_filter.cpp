#include "drivers/gpio/edge_filter.h"

#include <utility>

namespace hord::drivers {

void EdgeFilter::feed(const GpioEdge& raw, std::vector<Edge>& edges) {
    if (unrest_ && raw.at - unrest_->last >= debounce_) end_bounce_burst(unrest_->active, edges);
    if (!unrest_) {
        unrest_.emplace();
        unrest_->first = raw.at;
    }
    doubted_since_.reset();
    unrest_->last = raw.at;
    unrest_->due = raw.at + debounce_;
    unrest_->doubted = false;
    unrest_->active = raw.active;
    unrest_->lost += raw.lost;
    ++unrest_->edges;
}

std::optional<hal::TimePoint> EdgeFilter::due() const {
    if (!unrest_) return std::nullopt;
    return unrest_->due;
}

void EdgeFilter::settle(hal::TimePoint now, bool active, std::vector<Edge>& edges) {
    if (unrest_) {
        if (now < unrest_->due) return;
        if (active != unrest_->active && !unrest_->doubted) {
            unrest_->doubted = true;
            unrest_->due = now + kDoubt;
            return;
        }
        end_bounce_burst(active, edges);
    } else if (active == active_) {
        doubted_since_.reset();
    } else if (!doubted_since_) {
        doubted_since_ = now;
    } else if (now - *doubted_since_ >= kDoubt) {
        doubted_since_.reset();
        tell(active, now, 1, edges);
    }
}

void EdgeFilter::end_bounce_burst(bool active, std::vector<Edge>& edges) {
    const BounceBurst bounce_burst = *std::exchange(unrest_, std::nullopt);
    if (active != active_) {
        bounces_ += bounce_burst.edges - 1;
        tell(active, bounce_burst.first, bounce_burst.lost, edges);
        return;
    }
    const bool never_seen = bounce_burst.edges == 1;
    bounces_ += never_seen ? 0 : bounce_burst.edges;
    const std::uint32_t lost = bounce_burst.lost + (never_seen ? 2 : 0);
    untold_ += lost;
    lost_ += lost;
}

void EdgeFilter::tell(bool active, hal::TimePoint at, std::uint32_t lost, std::vector<Edge>& edges) {
    active_ = active;
    lost_ += lost;
    sequence_ += std::exchange(untold_, 0U) + lost + 1;
    edges.push_back({active, at, sequence_});
}

}  // namespace hord::drivers
