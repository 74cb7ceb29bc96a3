#include "drivers/camera_process/camera_part_sensor.h"

namespace hord::drivers {

using hal::PartEdge;

CameraPartSensor::CameraPartSensor(hal::EventLoop& loop, CameraPortSensor& camera, bool active_low)
    : loop_(loop), camera_(camera), active_low_(active_low) {
    camera_.tell_edges(this);
}

CameraPartSensor::~CameraPartSensor() {
    stop();
    camera_.tell_edges(nullptr);
}

Result<void> CameraPartSensor::do_start(Listener& listener) {
    listener_ = &listener;
    sequence_ = 0;
    return {};
}

void CameraPartSensor::do_stop() {
    loop_.cancel(lost_timer_);
    listener_ = nullptr;
}

void CameraPartSensor::on_camera_edge(const CameraEdge& edge) {
    sequence_ += edge.sequence - heard_;
    heard_ = edge.sequence;
    if (listener_ == nullptr) return;
    const bool covered = edge.active != active_low_;
    listener_->on_edge({covered ? PartEdge::Kind::arrives : PartEdge::Kind::leaves, edge.at, sequence_, {}});
}

void CameraPartSensor::on_camera_lost(const Error& error) {
    if (listener_ == nullptr) return;
    loop_.cancel(lost_timer_);
    lost_timer_ = loop_.call_after({}, [this, error] { listener_->on_part_sensor_lost(error); });
}

}  // namespace hord::drivers
