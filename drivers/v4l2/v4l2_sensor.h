// A lenslet sensor behind a V4L2 video device: mmap streaming, nothing copied.
//
// The pipeline reads the driver's own buffer; giving the lease back queues it again. GREY, Y10, Y12 and Y16 (two bytes
// a sample, right-aligned); a device that has Y10P or Y12P alone has them unpacked, which is a copy. The camera runs
// free or is triggered by wire: a frame is delivered to the oldest trigger that waits, unless by the device's stamp it
// began before that trigger's start, by however little; a frame that nobody asked for goes straight back and is
// counted, and is not a gap in the sequence.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/sensor.h"

namespace hord::drivers {

struct V4l2SensorOptions {
    std::string device = "/dev/video0";
    int width_px = 0;  // 0: as the device is set
    int height_px = 0;
    int bits = 8;     // 8: GREY, 10: Y10 or Y10P, 12: Y12 or Y12P, 16: Y16
    int buffers = 4;  // 2..32; frames that may be lent at the same time is one less
    std::vector<std::pair<std::string, std::int64_t>> controls;  // by name, as v4l2-ctl prints it; set at start
};

class V4l2Sensor final : public hal::Sensor {
  public:
    // Loop thread; blocks for the device's own open. Checks the device and agrees on the format; takes no buffer yet.
    // Fails with not_found, busy, unsupported (no capture device, the format: lists what there is; a control), io.
    static Result<std::unique_ptr<V4l2Sensor>> open(hal::EventLoop& loop, const V4l2SensorOptions& options);
    ~V4l2Sensor() override;

    [[nodiscard]] std::uint64_t unasked() const { return unasked_; }  // frames that came without a trigger

  private:
    struct Stream;  // the descriptor and its mapped buffers; lives as long as a lease needs it
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
    std::uint64_t unasked_ = 0;
    std::uint32_t unasked_now_ = 0;  // since start

    // Leases name (generation, buffer) in their slot, so that one of an earlier stream goes back to that stream.
    struct Loans;
    std::unique_ptr<Loans> loans_;
};

}  // namespace hord::drivers
