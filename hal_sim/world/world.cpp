#include "hal_sim/world/world.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "hal_sim/world/random.h"

namespace hord::sim {
namespace {

using hal::TimePoint;

constexpr std::uint64_t kPitchStream = 0x9175;
constexpr std::uint64_t kKindStream = 0x6B1D;
constexpr std::uint64_t kGapStream = 0x6A9;

// A part is kept for this long after it is gone: the valve's motion or a frame may be reported with a time in the past.
constexpr hal::Duration kMemory = std::chrono::seconds(2);

constexpr double kHeldBeforeSensorMm = 1e-3;  // from the sensor to a part that was due there when the feed stopped

}  // namespace

World::World(hal::EventLoop& loop, InjectionPlan& faults, const ConveyorOptions& conveyor,
             const ScheduleOptions& schedule, const GeometryOptions& geometry, std::uint64_t seed)
    : loop_(loop), faults_(faults), conveyor_options_(conveyor), schedule_(schedule), geometry_(geometry), seed_(seed) {
    for (const PartKind& kind : schedule_.kinds) share_sum_ += kind.share;
}

World::~World() {
    loop_.cancel(timer_);
    loop_.cancel(coasting_);
    for (const auto timer : meddling_) loop_.cancel(timer);
}

void World::start() {
    if (conveyor_) return;
    conveyor_.emplace(conveyor_options_, seed_, loop_.now());
    if (!may_move_) conveyor_->halt(loop_.now());
    last_front_mm_ = schedule_.first_mm - schedule_.pitch_mm;
    draw_part();
    plan();
}

void World::draw_part() {
    if (schedule_.parts != 0 && drawn_ == schedule_.parts) return;
    PartRecord part;
    part.number = drawn_ + 1;
    const double jitter = drawn_ == 0 ? 0 : schedule_.pitch_jitter * random_sign(seed_, kPitchStream, drawn_);
    part.front_mm = last_front_mm_ + schedule_.pitch_mm * (1 + jitter);
    const bool close = faults_.fires(InjectedFault::part_close).has_value(),
               missing = faults_.fires(InjectedFault::part_missing).has_value();
    if (missing) part.front_mm += schedule_.pitch_mm;
    if (faults_.fires(InjectedFault::part_touching) && drawn_ > 0) {
        part.touches_ahead = line_.back().touched_behind = true;
        part.front_mm = line_.back().front_mm + schedule_.part_length_mm;
    } else if (close && drawn_ > 0) {
        part.front_mm =
            line_.back().front_mm + (1.1 + 0.5 * random_unit(seed_, kGapStream, drawn_)) * schedule_.part_length_mm;
    }
    double lot = random_unit(seed_, kKindStream, drawn_) * share_sum_;
    while (part.kind + 1 < schedule_.kinds.size() && lot >= schedule_.kinds[part.kind].share)
        lot -= schedule_.kinds[part.kind++].share;
    part.bad = schedule_.kinds[part.kind].bad;
    last_front_mm_ = part.front_mm;
    ++drawn_;
    line_.push_back(part);
}

void World::plan() {
    loop_.cancel(timer_);
    next_ = Next::nothing;
    next_at_ = TimePoint::max();
    const auto consider = [&](Next what, std::uint64_t index, double offset_mm) {
        const PartRecord* part = with_index(index);
        if (part == nullptr) return;
        const TimePoint at = conveyor_->time_at(part->front_mm + offset_mm);
        if (at < next_at_) {
            next_ = what;
            next_at_ = at;
        }
    };
    // A part that the feeder holds has not arrived: it neither leaves the sensor nor the line.
    if (next_exit_ < next_arrival_) consider(Next::exit, next_exit_, geometry_.exit_mm);
    if (next_departure_ < next_arrival_) consider(Next::departure, next_departure_, schedule_.part_length_mm);
    if (!unfed_since_mm_) consider(Next::arrival, next_arrival_, 0);
    if (next_ != Next::nothing) timer_ = loop_.call_at(next_at_, [this] { act(); });
}

void World::act() {
    const TimePoint at = next_at_;
    PartRecord* edge = nullptr;
    const Next what = next_;
    if (what == Next::arrival) {
        edge = with_index(next_arrival_++);
        edge->arrived = at;
        ++totals_.arrived;
        draw_part();
        edge = with_index(next_arrival_ - 1);
        const PartRecord* ahead = next_arrival_ >= 2 ? with_index(next_arrival_ - 2) : nullptr;
        edge->touches_ahead = edge->touches_ahead && ahead != nullptr && ahead->fate == PartRecord::Fate::on_line;
    } else if (what == Next::departure) {
        edge = with_index(next_departure_++);
        if (edge->fate == PartRecord::Fate::removed) edge = nullptr;  // its edge left with it
    } else {
        PartRecord& part = *with_index(next_exit_++);
        if (part.fate == PartRecord::Fate::on_line && ejector_open_since_) eject_between(*ejector_open_since_, at);
        if (part.fate == PartRecord::Fate::on_line) settle(part, PartRecord::Fate::left, at);
        // Forgets a part only if its fate is decided, every cursor is past it, and it is old enough.
        while (first_index_ < next_exit_ && first_index_ < next_departure_ && line_.front().gone + kMemory < at) {
            line_.pop_front();
            ++first_index_;
        }
        conveyor_->forget_before(at - kMemory);
    }
    plan();
    if (edge != nullptr) {
        const PartRecord seen = *edge;  // a copy: the callback may change the line
        if (watchers_.part_edge) watchers_.part_edge(seen, what == Next::arrival, at);
        if (what == Next::arrival) apply_arrival_faults(seen);
    }
    if (what != Next::arrival && finished() && watchers_.over) watchers_.over();
}

void World::apply_arrival_faults(const PartRecord& arrived) {
    if (const auto after = faults_.fires(InjectedFault::part_removed)) {
        meddling_.push_back(loop_.call_after(*after, [this, number = arrived.number] {
            take_off([number](const PartRecord& part) { return part.number == number; });
        }));
    }
    coast_ = faults_.fires(InjectedFault::belt_coasts).value_or(coast_);
    if (const auto stands_for = faults_.fires(InjectedFault::belt_stop)) {
        ++stopped_;
        move();
        meddling_.push_back(loop_.call_after(*stands_for, [this] {
            --stopped_;
            move();
        }));
    }
}

void World::take_off(const std::function<bool(const PartRecord&)>& takes) {
    for (std::uint64_t index = std::max(next_exit_, first_index_); index < next_arrival_; ++index) {
        PartRecord& part = *with_index(index);
        if (part.fate != PartRecord::Fate::on_line || !takes(part)) continue;
        settle(part, PartRecord::Fate::removed, loop_.now());
        const PartRecord taken = part;
        if (index >= next_departure_ && watchers_.part_edge) watchers_.part_edge(taken, false, loop_.now());
    }
}

void World::halt() {
    loop_.cancel(coasting_);
    may_move_ = false;
    move();
}

void World::run_out() {
    if (!may_move_ || !conveyor_ || coast_ == hal::Duration::zero()) return halt();
    PartRecord* const next = with_index(next_arrival_);
    if (unfed_since_mm_ && next != nullptr && next_exit_ == next_arrival_) {  // onto the empty belt
        const double shift = conveyor_->position_mm(loop_.now()) + kHeldBeforeSensorMm - next->front_mm;
        next->front_mm += shift;
        last_front_mm_ += shift;
        unfed_since_mm_.reset();
        plan();
    }
    loop_.cancel(coasting_);
    coasting_ = loop_.call_after(coast_, [this] { halt(); });
}

void World::resume() {
    loop_.cancel(coasting_);
    may_move_ = true;
    move();
}

void World::feed(bool on) {
    if (!conveyor_ || on == !unfed_since_mm_) return;
    const double at_mm = conveyor_->position_mm(loop_.now());
    PartRecord* const next = with_index(next_arrival_);
    if (!on) {
        unfed_since_mm_ = at_mm;
        PartRecord* const ahead = next_arrival_ == 0 ? nullptr : with_index(next_arrival_ - 1);
        if (next != nullptr) next->touches_ahead = false;
        if (ahead != nullptr) ahead->touched_behind = false;
    } else {
        // The part was held before the sensor. In real time it may already have been due there, if the feed was stopped
        // late. Its place is ahead of the belt's present one: the belt was at the present one when it last stopped.
        const double stood = at_mm - *std::exchange(unfed_since_mm_, std::nullopt);
        const double shift = next == nullptr ? stood : std::max(stood, at_mm + kHeldBeforeSensorMm - next->front_mm);
        if (next != nullptr) next->front_mm += shift;
        last_front_mm_ += shift;
    }
    plan();
}

void World::move() {
    const bool stands = !may_move_ || stopped_ > 0;
    if (!conveyor_ || conveyor_->halted() == stands) return;
    if (stands) conveyor_->halt(loop_.now());
    else conveyor_->resume(loop_.now());
    plan();
}

void World::settle(PartRecord& part, PartRecord::Fate fate, TimePoint at) {
    part.fate = fate;
    part.gone = at;
    const bool ejected = fate == PartRecord::Fate::ejected;
    if (fate == PartRecord::Fate::removed) ++totals_.removed;
    else
        ++(ejected ? (part.bad ? totals_.ejected_bad : totals_.ejected_good)
                   : (part.bad ? totals_.left_bad : totals_.left_good));
    if (watchers_.part_gone) watchers_.part_gone(part);
}

void World::eject_between(TimePoint from, TimePoint until) {
    const double low = conveyor_->position_mm(from), high = conveyor_->position_mm(std::max(from, until));
    for (std::uint64_t index = first_index_; index < next_arrival_; ++index) {
        PartRecord& part = *with_index(index);
        const double nearest = part.front_mm + geometry_.ejector_mm - geometry_.ejector_reach_mm;
        const double farthest = nearest + 2 * geometry_.ejector_reach_mm;
        if (nearest > high) break;  // and so is every part behind it
        if (part.fate != PartRecord::Fate::on_line || farthest < low) continue;
        ++hit_by_pulse_;
        settle(part, PartRecord::Fate::ejected, std::max(from, conveyor_->time_at(nearest)));
    }
}

void World::set_ejector(bool open, TimePoint at) {
    if (!conveyor_ || open == ejector_open_since_.has_value()) return;
    if (open) {
        ejector_open_since_ = at;
        hit_by_pulse_ = 0;
        ++totals_.ejector_pulses;
        eject_between(at, at);
    } else {
        eject_between(*ejector_open_since_, at);
        if (hit_by_pulse_ == 0) ++totals_.empty_pulses;
        ejector_open_since_.reset();
    }
    if (watchers_.ejector) watchers_.ejector(open, at);
}

World::InView World::in_view(TimePoint at) {
    if (!conveyor_) return {};
    const double centre = conveyor_->position_mm(at) - geometry_.camera_mm;
    InView best;
    for (std::uint64_t index = first_index_; index < next_arrival_; ++index) {
        PartRecord& part = *with_index(index);
        const double offset = centre - part.front_mm;
        if (offset < -geometry_.camera_reach_mm) break;
        if ((part.fate == PartRecord::Fate::ejected || part.fate == PartRecord::Fate::removed) && part.gone <= at)
            continue;
        if (offset > geometry_.camera_reach_mm) continue;
        if (best.part == nullptr || std::abs(offset) < std::abs(best.offset_mm)) best = {&part, offset};
    }
    return best;
}

bool World::finished() const {
    return schedule_.parts != 0 && drawn_ == schedule_.parts && next_exit_ == drawn_ && next_departure_ == drawn_;
}

}  // namespace hord::sim
