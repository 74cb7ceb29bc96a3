// A lenslet sensor behind a V4L2 video device, by mmap streaming (camera_sensor.h). Formats: GREY, Y10, Y12 and Y16
// (two bytes a sample, right-aligned); of a device that has only Y10P or Y12P, samples are unpacked into a copy.
#pragma once

#include <memory>

#include "drivers/hal/camera_sensor.h"
#include "drivers/v4l2/v4l2_options.h"

namespace hord::drivers {

class V4l2Sensor final : public CameraSensor {
  public:
    // Loop thread; blocks while the device is opened. Negotiates the format; allocates no buffer yet.
    // Fails with not_found, busy, unsupported (no capture device; the format, lists the available ones; a control), io.
    static Result<std::unique_ptr<V4l2Sensor>> open(hal::EventLoop& loop, const V4l2SensorOptions& options);
    ~V4l2Sensor() override;

  private:
    struct Stream;  // the descriptor and its mapped buffers
    V4l2Sensor(hal::EventLoop& loop, const V4l2SensorOptions& options);
    Result<void> do_start(Listener& listener) override;
    void do_stop() override;
    void on_ready() override;
    Result<std::shared_ptr<Stream>> open_stream();

    const V4l2SensorOptions options_;
    int fd_ = -1;  // of the stream
};

}  // namespace hord::drivers
