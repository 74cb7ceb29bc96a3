// A lenslet sensor behind a V4L2 video device: mmap streaming, nothing copied.
//
// The pipeline reads the driver's buffer; returning the lease queues it again. Formats: GREY, Y10, Y12 and Y16 (two
// bytes a sample, right-aligned); of a device that has only Y10P or Y12P, samples are unpacked into a copy. The camera
// runs free or is triggered by wire. A frame answers the oldest open trigger, unless its time stamp is before that
// trigger's start. A frame without a trigger is queued again, counted, and leaves no gap in the sequence.
#pragma once

#include <memory>
#include <vector>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/sensor.h"
#include "drivers/v4l2/v4l2_options.h"

namespace hord::drivers {

class V4l2Sensor final : public hal::Sensor {
  public:
    // Loop thread; blocks while the device is opened. Negotiates the format; allocates no buffer yet.
    // Fails with not_found, busy, unsupported (no capture device; the format, lists the available ones; a control), io.
    static Result<std::unique_ptr<V4l2Sensor>> open(hal::EventLoop& loop, const V4l2SensorOptions& options);
    ~V4l2Sensor() override;

    [[nodiscard]] std::uint64_t untriggered() const { return untriggered_; }  // frames without a trigger

  private:
    struct Stream;  // the descriptor and its mapped buffers; leases keep it alive
    V4l2Sensor(hal::EventLoop& loop, const V4l2SensorOptions& options);
    [[nodiscard]] hal::SensorFormat do_format() const override { return format_; }
    Result<void> do_start(Listener& listener) override;
    Result<void> do_trigger(const hal::ExposureRequest& request) override;
    void do_stop() override;
    void do_give_back(std::uint32_t slot) noexcept override;

    void on_ready();
    bool watch_again(int fd);
    void lose(const char* what, int error);
    Result<std::shared_ptr<Stream>> open_stream();

    hal::EventLoop& loop_;
    V4l2SensorOptions options_;
    hal::SensorFormat format_;
    std::ptrdiff_t stride_bytes_ = 0;
    Listener* listener_ = nullptr;
    bool lost_ = false;
    hal::EventLoop::WatchId watch_{};
    hal::EventLoop::TimerId lost_timer_{};
    std::vector<hal::ExposureRequest> waiting_;
    std::uint64_t untriggered_ = 0;
    std::uint32_t untriggered_in_stream_ = 0;  // since start

    // A lease's slot holds (generation, buffer): a lease of an earlier stream is returned to that stream.
    struct LeaseTable;
    std::unique_ptr<LeaseTable> leases_;
};

}  // namespace hord::drivers
