// A light barrier on a GPIO line, and an encoder's line where there is one.
//
// Edges have the kernel's time stamps, are debounced (edge_filter.h) and told when that is over; active means covered.
// A line that does not come to rest, an edge that the kernel could not keep and a chip that went away are recognised:
// the first and the last as a loss of the sensor, the other as a gap in the sequence. The chip's absence is noticed
// within kLookEvery: the kernel wakes nobody for it.
//
// An encoder with one line counts activations, and cannot tell backwards from forwards: tracking by it needs a
// conveyor that never runs back. Counts that were lost lose the position, and so the sensor.
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

struct GpioPartSensorOptions {
    GpioLine line;
    hal::Duration debounce = std::chrono::microseconds(200);  // 0..100 ms; edges are told so much later
    std::optional<GpioLine> encoder;
    hal::Duration encoder_every = std::chrono::milliseconds(5);  // its readings
    bool operator==(const GpioPartSensorOptions&) const = default;
};

class GpioPartSensor final : public hal::PartSensor {
  public:
    static constexpr hal::Duration kLookEvery = std::chrono::milliseconds(50);
    // A line that goes on and off for longer than this, or twenty times the debounce, is no part's.
    static constexpr hal::Duration kUnrest = std::chrono::milliseconds(50);

    using Lines = std::function<Result<std::unique_ptr<GpioInput>>(const GpioLine&, GpioEdges)>;

    // Loop thread; blocks for the chips' open. Takes the lines, and lets go of them again: start() holds them.
    // Fails as request_input() does, and with invalid_argument (debounce, encoder_every).
    static Result<std::unique_ptr<GpioPartSensor>> open(hal::EventLoop& loop, const GpioPartSensorOptions& options,
                                                        Lines lines = request_input);
    ~GpioPartSensor() override;

    [[nodiscard]] std::uint64_t bounces() const { return filter_ ? filter_->bounces() : 0; }  // since start
    [[nodiscard]] std::uint64_t lost() const { return filter_ ? filter_->lost() : 0; }

  private:
    GpioPartSensor(hal::EventLoop& loop, const GpioPartSensorOptions& options, Lines lines);
    Result<void> do_start(Listener& listener) override;
    void do_stop() override;

    void on_ready();
    void look();
    void read_encoder();
    bool take_edges();       // false: lost, or stopped by the listener
    bool settle_when_due();  // the same
    void take_encoder();
    void lose(const Error& why);
    void release();

    hal::EventLoop& loop_;
    GpioPartSensorOptions options_;
    Lines lines_;
    Listener* listener_ = nullptr;
    std::unique_ptr<GpioInput> part_, encoder_;
    hal::EventLoop::WatchId part_watch_{}, encoder_watch_{};
    hal::EventLoop::TimerId look_timer_{}, settle_timer_{}, reading_timer_{}, lost_timer_{};
    std::uint32_t starts_ = 0;
    std::optional<EdgeFilter> filter_;
    std::optional<EncoderTrack> track_;
    std::vector<GpioEdge> raw_;
    std::vector<EdgeFilter::Edge> edges_;
};

}  // namespace hord::drivers
