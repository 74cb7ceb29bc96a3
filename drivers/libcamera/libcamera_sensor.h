// A lenslet sensor behind libcamera: the same contract as the V4L2 sensor's, nothing copied but packed samples.
//
// libcamera completes requests on its own thread; they are handed over without waiting, and the pipeline reads the
// camera's own buffer. Giving the lease back queues its request again. A frame is delivered to the oldest trigger that
// waits and whose start it does not precede, by the sensor's time stamp (of the exposure's start, where the camera
// tells it); a frame that nobody asked for goes straight back and is no gap in the sequence.
//
// A camera that goes away while its buffers are with it is told by nobody, where the process may not listen to the
// kernel's device events: so one that was asked for a frame and has brought none at all for kSilence after that
// exposure is lost.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/sensor.h"
#include "drivers/libcamera/camera_port.h"

namespace hord::drivers {

class LibcameraSensor final : public hal::Sensor {
  public:
    static constexpr hal::Duration kSilence = std::chrono::seconds(2);

    // Loop thread; blocks while the camera is asked. Fails with not_found (lists the cameras), busy, unsupported (lists
    // the formats), io, invalid_argument (buffers not in 2..32).
    static Result<std::unique_ptr<LibcameraSensor>> open(hal::EventLoop& loop, const CameraRequest& request);
    // The same over another camera.
    static Result<std::unique_ptr<LibcameraSensor>> open(hal::EventLoop& loop, const CameraRequest& request,
                                                         std::unique_ptr<CameraPort> port);
    ~LibcameraSensor() override;

  private:
    struct Stream;
    LibcameraSensor(hal::EventLoop& loop, const CameraRequest& request, std::unique_ptr<CameraPort> port,
                    const CameraFormat& format);
    [[nodiscard]] hal::SensorFormat do_format() const override { return format_; }
    Result<void> do_start(Listener& listener) override;
    Result<void> do_trigger(const hal::ExposureRequest& request) override;
    void do_stop() override;
    void do_give_back(std::uint32_t slot) noexcept override;

    void take();  // what was handed over
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
    hal::TimePoint last_frame_{};  // when one came, asked for or not
    std::vector<hal::ExposureRequest> waiting_;
    std::uint32_t unasked_ = 0;

    struct Loans;  // leases name (generation, buffer) in their slot: one of an earlier stream goes back to nobody
    std::unique_ptr<Loans> loans_;
};

}  // namespace hord::drivers
