#include "lab/soak/device_proxies.h"

namespace hord::lab {
namespace {

tl::unexpected<Error> gone() { return fail(ErrorCode::disconnected, "the process is gone"); }

}  // namespace

DeviceProxies::DeviceProxies(sim::SimulatedCell& cell, Invariants& invariants) : cell_(cell), invariants_(invariants) {}

void DeviceProxies::cut() {
    cut_ = true;
    cell_.strobe().stop();
    cell_.part_sensor().stop();
    cell_.sensor().stop();
}

void DeviceProxies::after_calls(int n, std::function<void()> what) {
    calls_left_ = n;
    then_ = std::move(what);
}

void DeviceProxies::count_call() {
    if (!then_ || calls_left_-- > 0) return;
    std::exchange(then_, nullptr)();
}

Result<void> DeviceProxies::PartSensorProxy::do_start(hal::PartSensor::Listener& to) {
    listener = &to;
    auto done = gates.cell_.part_sensor().start(*this);
    gates.invariants_.part_sensor_up(done.has_value());
    return done;
}
void DeviceProxies::PartSensorProxy::do_stop() {
    if (gates.cut_) return;
    gates.invariants_.part_sensor_up(false);
    gates.cell_.part_sensor().stop();
}
void DeviceProxies::PartSensorProxy::on_edge(const hal::PartEdge& edge) {
    listener->on_edge(edge);
    if (edge.kind == hal::PartEdge::Kind::arrives) gates.invariants_.edge_delivered(edge);
}

Result<void> DeviceProxies::StrobeProxy::do_start(hal::Strobe::Listener& to) {
    listener = &to;
    return gates.cell_.strobe().start(*this);
}
Result<void> DeviceProxies::StrobeProxy::do_fire(const hal::StrobePulse& pulse) {
    gates.count_call();
    if (gates.cut_) return gone();
    auto done = gates.cell_.strobe().fire(pulse);
    if (done) gates.invariants_.lit(pulse);
    return done;
}
void DeviceProxies::StrobeProxy::do_stop() {
    if (!gates.cut_) gates.cell_.strobe().stop();
}
void DeviceProxies::StrobeProxy::on_strobe(const hal::StrobeReport& report) {
    if (gates.cut_) return;
    gates.invariants_.strobe_reported(report);
    listener->on_strobe(report);
}

Result<void> DeviceProxies::SensorProxy::do_start(hal::Sensor::Listener& to) {
    listener = &to;
    return gates.cell_.sensor().start(*this);
}
Result<void> DeviceProxies::SensorProxy::do_trigger(const hal::ExposureRequest& request) {
    gates.count_call();
    if (gates.cut_) return gone();
    return gates.cell_.sensor().trigger(request);
}
void DeviceProxies::SensorProxy::do_stop() {
    if (!gates.cut_) gates.cell_.sensor().stop();
}

Result<void> DeviceProxies::RejectorProxy::do_start(hal::Rejector::Listener& to) {
    listener = &to;
    return gates.cell_.rejector().start(*this);
}
Result<void> DeviceProxies::RejectorProxy::do_reject(const hal::RejectCommand& command) {
    gates.count_call();
    if (gates.cut_) return gone();
    gates.invariants_.rejecting(command);
    auto done = gates.cell_.rejector().reject(command);
    gates.invariants_.rejecting_done(done.has_value());
    return done;
}
void DeviceProxies::RejectorProxy::do_set_run_permit(bool permit) {
    gates.count_call();
    if (!gates.cut_) gates.cell_.rejector().set_run_permit(permit);
}
void DeviceProxies::RejectorProxy::do_stop() {
    if (!gates.cut_) gates.cell_.rejector().stop();
}

}  // namespace hord::lab
