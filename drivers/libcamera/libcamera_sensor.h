// A lenslet sensor behind libcamera, with the V4L2 sensor's contract. Only packed and colour formats are copied.
//
// The camera's thread queues completed frames without blocking, and the pipeline reads the camera's buffer; returning
// the lease queues the buffer again. A frame answers the oldest open trigger, unless its time stamp (of the exposure's
// start, if the camera reports it) is before that trigger's start. A frame without a trigger is queued again and leaves
// no gap in the sequence.
//
// A process without access to the kernel's device events is not notified when a camera goes away while it holds its
// buffers. So a camera is lost if it delivered no frame at all for kSilence after a triggered exposure.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/sensor.h"
#include "drivers/libcamera/camera_port.h"
#include "drivers/libcamera/libcamera_options.h"

namespace hord::drivers {

class LibcameraSensor final : public hal::Sensor {
  public:
    static constexpr hal::Duration kSilence = std::chrono::seconds(2);

    // Loop thread; blocks while the camera is configured. Fails with not_found (lists the cameras), busy, unsupported
    // (lists the formats), io, invalid_argument (buffers not in 2..32).
    static Result<std::unique_ptr<LibcameraSensor>> open(hal::EventLoop& loop, const LibcameraSensorOptions& request);
    // The same with another camera.
    static Result<std::unique_ptr<LibcameraSensor>> open(hal::EventLoop& loop, const LibcameraSensorOptions& request,
                                                         std::unique_ptr<CameraPort> port);
    ~LibcameraSensor() override;

  private:
    struct Stream;
    LibcameraSensor(hal::EventLoop& loop, const LibcameraSensorOptions& request, std::unique_ptr<CameraPort> port,
                    const CameraFormat& format);
    [[nodiscard]] hal::SensorFormat do_format() const override { return format_; }
    Result<void> do_start(Listener& listener) override;
    Result<void> do_trigger(const hal::ExposureRequest& request) override;
    void do_stop() override;
    void do_give_back(std::uint32_t slot) noexcept override;

    void read_frames();  // from the camera's thread
    void deliver(const CameraFrame& frame);
    void watch_for_silence();
    void lose(const std::string& what);

    hal::EventLoop& loop_;
    const std::string name_;
    const int buffers_;
    const std::unique_ptr<CameraPort> port_;
    CameraFormat camera_;
    hal::SensorFormat format_;
    Listener* listener_ = nullptr;
    bool lost_ = false;
    hal::EventLoop::WatchId watch_{};
    hal::EventLoop::TimerId lost_timer_{}, silence_timer_{};
    hal::TimePoint last_frame_{};  // its arrival, triggered or not
    std::vector<hal::ExposureRequest> waiting_;
    std::uint32_t untriggered_ = 0;

    struct LeaseTable;  // a slot holds (generation, buffer): a lease of an earlier stream is not queued again
    std::unique_ptr<LeaseTable> leases_;
};

}  // namespace hord::drivers
