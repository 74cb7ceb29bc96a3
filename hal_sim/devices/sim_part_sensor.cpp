#include "hal_sim/devices/sim_part_sensor.h"

#include <cmath>

namespace hord::sim {

using hal::Duration;
using hal::TimePoint;

Result<void> SimPartSensor::do_start(Listener& listener) {
    if (loop_.now() < back_at_)
        return fail(ErrorCode::not_found, "simulated part sensor is gone", "start it again when it is back");
    listener_ = &listener;
    sequence_ = 0;
    if (options_.encoder_counts_per_mm > 0) {
        encoder_timer_ = loop_.call_after(options_.encoder_every, [this] { read_encoder(); });
        zero_mm_ = world_.belt_mm(loop_.now()) - slipped_mm_;
    }
    return {};
}

void SimPartSensor::do_stop() {
    listener_ = nullptr;
    loop_.cancel(encoder_timer_);
    loop_.cancel(lost_timer_);
    pending_.drop([](const hal::PartEdge&) {});
}

std::int64_t SimPartSensor::counts_at(TimePoint at) {
    const double moved_mm = world_.belt_mm(at) - slipped_mm_ - zero_mm_;
    return static_cast<std::int64_t>(std::floor(moved_mm * options_.encoder_counts_per_mm));
}

void SimPartSensor::read_encoder() {
    encoder_timer_ = loop_.call_after(options_.encoder_every, [this] { read_encoder(); });
    const TimePoint now = loop_.now();
    if (now < silent_until_) return;
    listener_->on_encoder({now, counts_at(now)});
}

void SimPartSensor::lose(Duration gone_for) {
    back_at_ = loop_.now() + gone_for;
    Listener* listener = listener_;
    do_stop();
    lost_timer_ = loop_.call_after({}, [listener] {
        listener->on_part_sensor_lost(
            {ErrorCode::disconnected, "simulated part sensor is gone", "stop it and start it again"});
    });
}

void SimPartSensor::part_edge(bool arrives, TimePoint at) {
    if (listener_ == nullptr) return;
    if (!arrives) {
        if (!std::exchange(swallow_departure_, false)) emit(Kind::leaves, at);
        return;
    }
    if (const auto amount = faults_.fires(InjectedFault::part_sensor_lost)) return lose(*amount);
    if (const auto amount = faults_.fires(InjectedFault::encoder_slip)) {
        slipped_mm_ += 1e-9 * static_cast<double>(amount->count()) * world_.nominal_speed_mm_s();
    }
    if (const auto amount = faults_.fires(InjectedFault::encoder_silent)) silent_until_ = loop_.now() + *amount;
    const bool missed = faults_.fires(InjectedFault::edge_missed).has_value(),
               lost = faults_.fires(InjectedFault::edge_lost).has_value();
    const auto bounces_for = faults_.fires(InjectedFault::edge_bounce),
               ghost_after = faults_.fires(InjectedFault::edge_ghost);
    swallow_departure_ = missed;
    if (lost) ++sequence_;
    if (!missed && !lost) emit(Kind::arrives, at);
    if (bounces_for) {
        for (int k = 1; k <= 4; ++k) emit(k % 2 == 1 ? Kind::leaves : Kind::arrives, at + *bounces_for * k / 4);
    }
    if (ghost_after) emit(Kind::arrives, at + *ghost_after);
}

void SimPartSensor::emit(Kind kind, TimePoint at) {
    pending_.add(at + options_.latency, {.kind = kind, .at = at, .sequence = 0, .counts = {}});
}

// All edges have the same latency, so they are delivered in order and numbered on delivery.
void SimPartSensor::deliver(hal::PartEdge edge) {
    edge.sequence = ++sequence_;
    if (options_.encoder_counts_per_mm > 0 && loop_.now() >= silent_until_) edge.counts = counts_at(edge.at);
    listener_->on_edge(edge);
}

}  // namespace hord::sim
