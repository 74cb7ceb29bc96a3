// Collimator LEDs on GPIO lines, one a channel.
//
// A thread of the driver's own turns them on and off: it sleeps until shortly before a pulse and then watches the
// clock, under the policy of the thread that starts it. A pulse is reported with the times just before the line was
// told to go on and just after it was told to go off: the light was on inside that.
//
// The limits of every channel are kept twice. fire() refuses what the station must not ask for; the thread keeps
// them once more by the clock, against pulses that truly began or ended later than asked: it lets a light rest from its
// true end, starts later for that, and does not light where the pulse's time is over. A thread that the machine does
// not run cannot turn a light off: the LED driver's own one-shot is the last guard, and the report says how long it
// was.
//
// Lights are off when open() returns, between pulses, after every failure, after stop() and in the destructor. The
// lines are held from open() on, so that nobody else lights them. While no pulse is near they are told to be off every
// kLookEvery, so that a chip that went away is noticed, and reported as lost, before a part waits for its light. After
// a kill see gpio_lines.h.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "drivers/gpio/gpio_lines.h"
#include "drivers/gpio/light_budget.h"
#include "drivers/hal/event_loop.h"
#include "drivers/hal/strobe.h"

namespace hord::drivers {

struct GpioStrobeChannel {
    GpioLine line;
    LightLimits limits;
    bool operator==(const GpioStrobeChannel&) const = default;
};

class GpioStrobe final : public hal::Strobe {
  public:
    static constexpr std::size_t kPending = 64;  // pulses accepted and not yet begun
    static constexpr hal::Duration kWatch =
        std::chrono::microseconds(100);  // before a change the clock is watched, not slept on
    static constexpr hal::Duration kLookEvery = std::chrono::milliseconds(50);
    static constexpr hal::Duration kLookClear =
        std::chrono::milliseconds(10);  // so long before a pulse nothing else is done

    using Lines = std::function<Result<std::unique_ptr<GpioOutputs>>()>;

    // Loop thread; blocks for the chips' open. `loop` runs in real time, and outlives the driver.
    // Fails as request_outputs() does, and with invalid_argument (no channel, more than 32, an impossible limit).
    static Result<std::unique_ptr<GpioStrobe>> open(hal::EventLoop& loop,
                                                    const std::vector<GpioStrobeChannel>& channels);
    // The same over other lines: `lines` takes them, all off, and is asked again when start() follows a loss.
    static Result<std::unique_ptr<GpioStrobe>> open(hal::EventLoop& loop, std::vector<LightLimits> limits, Lines lines);
    ~GpioStrobe() override;

  private:
    struct Session;  // one start() to its stop()
    GpioStrobe(hal::EventLoop& loop, std::vector<LightLimits> limits, Lines lines);
    Result<void> do_start(Listener& listener) override;
    Result<void> do_fire(const hal::StrobePulse& pulse) override;
    void do_stop() override;
    [[nodiscard]] hal::StrobeLimits do_limits() const override;

    hal::EventLoop& loop_;
    std::vector<LightLimits> limits_;
    Lines lines_;
    std::unique_ptr<GpioOutputs> outputs_;  // the thread's while it runs; null after a loss
    LightBudget planned_, spent_;           // as asked for; as it was
    std::shared_ptr<Session> session_;
};

}  // namespace hord::drivers
