#include "hal_sim/world/conveyor.h"

#include <algorithm>
#include <cmath>

#include "hal_sim/world/random.h"

namespace hord::sim {

using hal::Duration;
using hal::TimePoint;

Conveyor::Conveyor(const ConveyorOptions& options, std::uint64_t seed, TimePoint start)
    : options_(options), seed_(seed), start_(start), drawn_to_(start) {
    draw_next();
}

void Conveyor::draw_next() {
    constexpr Duration kLong = std::chrono::seconds(10);  // of a stretch without jitter: keeps its numbers small
    constexpr std::uint64_t kStream = 0xBE17;
    double mm_per_ns = options_.speed_mm_s * 1e-9;
    Duration length = kLong;
    if (options_.jitter > 0) {
        mm_per_ns *= 1 + options_.jitter * random_sign(seed_, kStream, drawn_++);
        length = options_.jitter_every;
    }
    if (next_stop_ < options_.stops.size()) {
        const ConveyorOptions::Stop& stop = options_.stops[next_stop_];
        const TimePoint stops = start_ + stop.after;
        if (stops <= drawn_to_) {
            ++next_stop_;
            mm_per_ns = 0;
            length = stop.length;
        } else {
            length = std::min(length, stops - drawn_to_);
        }
    }
    stretches_.push_back({drawn_to_, drawn_to_mm_, mm_per_ns});
    drawn_to_ += length;
    drawn_to_mm_ = place(stretches_.back(), drawn_to_);
}

double Conveyor::position_mm(TimePoint at) {
    if (halted_ && at >= drawn_to_) return drawn_to_mm_;
    while (at > drawn_to_) draw_next();
    const auto after = std::upper_bound(stretches_.begin(), stretches_.end(), at,
                                        [](TimePoint t, const Stretch& s) { return t < s.from; });
    return place(after == stretches_.begin() ? stretches_.front() : *std::prev(after), at);
}

TimePoint Conveyor::time_at(double place_mm) {
    while (drawn_to_mm_ < place_mm) {
        if (halted_) return TimePoint::max();
        draw_next();
    }
    // The first stretch that ends at or behind the place.
    const auto after = std::partition_point(stretches_.begin() + 1, stretches_.end(),
                                            [&](const Stretch& s) { return s.from_mm < place_mm; });
    const Stretch& stretch = *std::prev(after);
    if (stretch.mm_per_ns <= 0) return stretch.from;
    const double ns = std::ceil((place_mm - stretch.from_mm) / stretch.mm_per_ns);
    return stretch.from + Duration(static_cast<Duration::rep>(std::max(0.0, ns)));
}

void Conveyor::halt(TimePoint at) {
    if (halted_) return;
    drawn_to_mm_ = position_mm(at);
    drawn_to_ = at;
    while (stretches_.size() > 1 && stretches_.back().from >= at) stretches_.pop_back();
    halted_ = true;
}

void Conveyor::resume(TimePoint at) {
    if (!halted_) return;
    halted_ = false;
    stretches_.push_back({drawn_to_, drawn_to_mm_, 0});
    drawn_to_ = std::max(at, drawn_to_);
    draw_next();
}

void Conveyor::forget_before(TimePoint at) {
    while (stretches_.size() > 1 && stretches_[1].from <= at) stretches_.pop_front();
}

}  // namespace hord::sim
