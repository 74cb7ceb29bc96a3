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

void DeviceProxies::after_calls(int n, std::function<void()> action) {
    calls_left_ = n;
    after_calls_ = std::move(action);
}

void DeviceProxies::count_call() {
    if (!after_calls_ || calls_left_-- > 0) return;
    std::exchange(after_calls_, nullptr)();
}

Result<void> DeviceProxies::PartSensorProxy::do_start(hal::PartSensor::Listener& to) {
    listener = &to;
    auto done = proxies.cell_.part_sensor().start(*this);
    proxies.invariants_.part_sensor_up(done.has_value());
    return done;
}
void DeviceProxies::PartSensorProxy::do_stop() {
    if (proxies.cut_) return;
    proxies.invariants_.part_sensor_up(false);
    proxies.cell_.part_sensor().stop();
}
void DeviceProxies::PartSensorProxy::on_edge(const hal::PartEdge& edge) {
    listener->on_edge(edge);
    if (edge.kind == hal::PartEdge::Kind::arrives) proxies.invariants_.edge_delivered(edge);
}

Result<void> DeviceProxies::StrobeProxy::do_start(hal::Strobe::Listener& to) {
    listener = &to;
    return proxies.cell_.strobe().start(*this);
}
Result<void> DeviceProxies::StrobeProxy::do_fire(const hal::StrobePulse& pulse) {
    proxies.count_call();
    if (proxies.cut_) return gone();
    auto done = proxies.cell_.strobe().fire(pulse);
    if (done) proxies.invariants_.lit(pulse);
    return done;
}
void DeviceProxies::StrobeProxy::do_stop() {
    if (!proxies.cut_) proxies.cell_.strobe().stop();
}
void DeviceProxies::StrobeProxy::on_strobe(const hal::StrobeReport& report) {
    if (proxies.cut_) return;
    proxies.invariants_.strobe_reported(report);
    listener->on_strobe(report);
}

Result<void> DeviceProxies::SensorProxy::do_start(hal::Sensor::Listener& to) {
    listener = &to;
    return proxies.cell_.sensor().start(*this);
}
Result<void> DeviceProxies::SensorProxy::do_trigger(const hal::ExposureRequest& request) {
    proxies.count_call();
    if (proxies.cut_) return gone();
    return proxies.cell_.sensor().trigger(request);
}
void DeviceProxies::SensorProxy::do_stop() {
    if (!proxies.cut_) proxies.cell_.sensor().stop();
}

Result<void> DeviceProxies::RejectorProxy::do_start(hal::Rejector::Listener& to) {
    listener = &to;
    return proxies.cell_.rejector().start(*this);
}
Result<void> DeviceProxies::RejectorProxy::do_reject(const hal::RejectCommand& command) {
    proxies.count_call();
    if (proxies.cut_) return gone();
    proxies.invariants_.rejecting(command);
    auto done = proxies.cell_.rejector().reject(command);
    proxies.invariants_.rejecting_done(done.has_value());
    return done;
}
void DeviceProxies::RejectorProxy::do_set_run_permit(bool permit) {
    proxies.count_call();
    if (!proxies.cut_) proxies.cell_.rejector().set_run_permit(permit);
}
void DeviceProxies::RejectorProxy::do_stop() {
    if (!proxies.cut_) proxies.cell_.rejector().stop();
}

}  // namespace hord::lab
