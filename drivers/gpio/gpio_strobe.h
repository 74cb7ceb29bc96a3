// Collimator LEDs on GPIO lines, one line a channel.
//
// The driver's own thread switches them, with the scheduling policy of the thread that calls start(). A report gives
// the time just before the line was switched on and the width until just after it was switched off.
//
// Each channel's limits are enforced twice: by fire() on the requested pulses, and by the thread on the measured
// pulses. A light's rest starts at the measured end of its pulse; a pulse may begin late, and is dropped when its time
// is over. A thread that the system does not schedule cannot switch a light off: the LED driver's own one-shot must
// limit that.
//
// The lights are off when open() returns, between pulses, after every failure, after stop() and in the destructor. The
// lines are held from open() on. For the state after a kill see gpio_lines.h.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "drivers/gpio/gpio_lines.h"
#include "drivers/hal/event_loop.h"
#include "drivers/hal/light_budget.h"
#include "drivers/hal/strobe.h"

namespace hord::drivers {

class GpioStrobe final : public hal::Strobe {
  public:
    static constexpr std::size_t kMaxPending = 64;  // pulses accepted and not yet begun
    // The thread polls the clock for this time before a change, instead of sleeping.
    static constexpr hal::Duration kSpinTime = std::chrono::microseconds(100);
    // "Off" is written again this often, but not within the margin before a pulse.
    static constexpr hal::Duration kCheckEvery = std::chrono::milliseconds(50);
    static constexpr hal::Duration kCheckMargin = std::chrono::milliseconds(10);

    using Lines = std::function<Result<std::unique_ptr<GpioOutputs>>()>;

    // Loop thread; blocks while the chips are opened. `loop` runs in real time and outlives the driver.
    // Fails as request_outputs() does, and with invalid_argument (no channel, more than 32, an impossible limit).
    static Result<std::unique_ptr<GpioStrobe>> open(hal::EventLoop& loop,
                                                    const std::vector<GpioStrobeChannel>& channels);
    // The same with other lines. `lines` requests them, all off; start() calls it again after a loss.
    static Result<std::unique_ptr<GpioStrobe>> open(hal::EventLoop& loop, std::vector<LightLimits> limits, Lines lines);
    ~GpioStrobe() override;
    [[nodiscard]] hal::StrobeLimits limits() const override;

  private:
    struct Session;  // one start() to its stop()
    GpioStrobe(hal::EventLoop& loop, std::vector<LightLimits> limits, Lines lines);
    Result<void> do_start(Listener& listener) override;
    Result<void> do_fire(const hal::StrobePulse& pulse) override;
    void do_stop() override;

    hal::EventLoop& loop_;
    std::vector<LightLimits> limits_;
    Lines lines_;
    std::unique_ptr<GpioOutputs> outputs_;  // moved to the thread while it runs; null after a loss
    hal::LightBudget planned_, spent_;      // of the requested pulses; of the measured pulses
    std::shared_ptr<Session> session_;
};

}  // namespace hord::drivers
