// The light that a camera's own output drives while it exposes (GenICam: LineSource = ExposureActive).
//
// fire() makes the camera expose, by a software trigger at the pulse's start: nothing else does, so the limits of the
// light are those of fire(), and Sensor::trigger() only waits for the frame. The exposure is the light: its length is
// the camera's ExposureTime, which the camera times and which was set and read back before it streams.
//
// Identity: the report of a pulse is made of the frame that its trigger brought, in the order of the triggers. Its
// start is the frame's time stamp. A pulse without a frame within kPatience, or with a frame that lost its time stamp,
// is reported as not lit, and so is one that is due before the frame of the one before has come: until then nobody
// knows when that light ended. A report proves an exposure, not light: a lamp that is broken shows in the frame alone.
//
// Dark: a camera that waits for software triggers does not expose. Without the station it loses its control and gets
// none.
#pragma once

#include <optional>
#include <vector>

#include "drivers/camera_process/camera_port_sensor.h"
#include "drivers/hal/light_budget.h"
#include "drivers/hal/strobe.h"

namespace hord::drivers {

class CameraStrobe final : public hal::Strobe, private CameraPortSensor::ExposureListener {
  public:
    static constexpr std::size_t kMaxPending = 64;  // pulses accepted and not yet begun
    static constexpr hal::Duration kPatience = std::chrono::seconds(1);

    // `camera` is triggered by software from here alone (CameraPortOptions::strobe_commands), exposes for `exposure`,
    // and outlives the strobe. It may be started after the strobe; fire() fails until then.
    CameraStrobe(hal::EventLoop& loop, CameraPortSensor& camera, const hal::LightLimits& limits,
                 hal::Duration exposure);
    ~CameraStrobe() override;

    // One channel; max_on is the exposure. fire() refuses a pulse of another width.
    [[nodiscard]] hal::StrobeLimits limits() const override;

  private:
    Result<void> do_start(Listener& listener) override;
    Result<void> do_fire(const hal::StrobePulse& pulse) override;
    void do_stop() override;
    void on_exposure(const CameraFrame& frame) override;
    void on_camera_lost(const Error& error) override;

    [[nodiscard]] hal::TimePoint next_at() const;
    void plan();
    void step();
    void begin(const hal::StrobePulse& pulse);
    void report_later(const hal::StrobeReport& report);
    void report_not_lit(const hal::StrobePulse& pulse);
    void give_up_on_frame();

    hal::EventLoop& loop_;
    CameraPortSensor& camera_;
    const hal::LightLimits limits_;
    const hal::Duration exposure_;
    hal::LightBudget planned_, spent_;
    Listener* listener_ = nullptr;
    bool lost_ = false;
    std::vector<hal::StrobePulse> pending_;
    struct Triggered {
        hal::StrobePulse pulse;
        hal::TimePoint sent;
    };
    std::optional<Triggered> triggered_;         // its frame has not come
    std::optional<hal::StrobeReport> exposing_;  // its frame has come before the end of its light
    hal::EventLoop::TimerId next_timer_{}, frame_timer_{}, report_timer_{};
};

}  // namespace hord::drivers
