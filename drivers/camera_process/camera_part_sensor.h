// A light barrier on a camera's input: the camera tells its edges (GenICam events).
//
// Edges have the camera's time stamps, in the station's clock. The camera debounces them, if it is told to. A message
// that was lost between camera and station leaves a gap in the sequence. The sensor hears while the camera streams; a
// camera that is lost is a lost part sensor.
#pragma once

#include "drivers/camera_process/camera_port_sensor.h"
#include "drivers/hal/part_sensor.h"

namespace hord::drivers {

class CameraPartSensor final : public hal::PartSensor, private CameraPortSensor::EdgeListener {
  public:
    // `camera` outlives it, and tells edges (GenicamSensorOptions::barrier_line). active_low: a part covers the barrier
    // while the input is inactive. It may be started before the camera.
    CameraPartSensor(hal::EventLoop& loop, CameraPortSensor& camera, bool active_low);
    ~CameraPartSensor() override;

  private:
    Result<void> do_start(Listener& listener) override;
    void do_stop() override;
    void on_camera_streams() override { heard_ = 0; }
    void on_camera_edge(const CameraEdge& edge) override;
    void on_camera_lost(const Error& error) override;

    hal::EventLoop& loop_;
    CameraPortSensor& camera_;
    const bool active_low_;
    Listener* listener_ = nullptr;
    std::uint32_t heard_ = 0;     // the camera's sequence
    std::uint32_t sequence_ = 0;  // since start()
    hal::EventLoop::TimerId lost_timer_{};
};

}  // namespace hord::drivers
