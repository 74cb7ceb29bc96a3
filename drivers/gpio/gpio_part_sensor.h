// A light barrier on a GPIO line, and optionally an encoder's line.
//
// Edges have the kernel's time stamps and are debounced (edge_filter.h); active means covered. An edge that the kernel
// could not keep leaves a gap in the sequence. A line that bounces for too long, a chip that went away (found within
// kCheckEvery) and lost encoder counts are reported as a loss of the sensor.
//
// An encoder with one line counts activations and does not know the direction: tracking by it needs a conveyor that
// never runs backwards.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "drivers/gpio/edge_filter.h"
#include "drivers/gpio/gpio_lines.h"
#include "drivers/hal/event_loop.h"
#include "drivers/hal/part_sensor.h"

namespace hord::drivers {

class GpioPartSensor final : public hal::PartSensor {
  public:
    static constexpr hal::Duration kCheckEvery = std::chrono::milliseconds(50);
    // The longest bounce burst; twenty times the debounce if that is longer.
    static constexpr hal::Duration kMaxBurst = std::chrono::milliseconds(50);

    using Lines = std::function<Result<std::unique_ptr<GpioInput>>(const GpioLine&, GpioEdges)>;

    // Loop thread; blocks while the chips are opened. Requests the lines and releases them: start() holds them.
    // Fails as request_input() does.
    static Result<std::unique_ptr<GpioPartSensor>> open(hal::EventLoop& loop, const GpioPartSensorOptions& options,
                                                        Lines lines = request_input);
    ~GpioPartSensor() override;

  private:
    GpioPartSensor(hal::EventLoop& loop, const GpioPartSensorOptions& options, Lines lines);
    Result<void> do_start(Listener& listener) override;
    void do_stop() override;

    void on_ready();
    void check_line();
    void report_position();
    bool read_edges();       // false: the sensor is lost, or the listener stopped it
    bool settle_when_due();  // the same
    void read_counts();
    void lose(const Error& why);
    void release();

    hal::EventLoop& loop_;
    GpioPartSensorOptions options_;
    Lines lines_;
    Listener* listener_ = nullptr;
    std::unique_ptr<GpioInput> part_, encoder_;
    hal::EventLoop::WatchId part_watch_{}, encoder_watch_{};
    hal::EventLoop::TimerId check_timer_{}, settle_timer_{}, position_timer_{}, lost_timer_{};
    std::uint32_t starts_ = 0;
    std::optional<EdgeFilter> filter_;
    std::optional<EncoderTrack> track_;
    std::vector<GpioEdge> raw_;
    std::vector<EdgeFilter::Edge> edges_;
};

}  // namespace hord::drivers
