// Collimators behind a Gardasoft RT controller. The controller times the pulse and regulates the current; the station
// sets both, reads them back, and triggers.
//
// Trigger: the controller's input, which a GPIO line or another strobe drives (`trigger`), or the command "TR". A
// command takes the time that the network and the controller take: its pulse counts as begun when the answer has come,
// the latest time at which it can have begun.
//
// The driver's own thread talks with the controller. The limits of each channel are enforced four times: the pulse's
// length, brightness and current at open(), and by the controller's own one-shot; rest and duty by fire() on the
// requested pulses, by the thread on the measured ones, and by the controller's retrigger delay.
//
// The lights are dark when open() returns: every output is set to 0 percent, then to pulse mode. Each kCheckEvery the
// thread reads the settings of one channel back, and the controller's errors. A controller that was switched off and on
// has its saved settings, which may be continuous light: it differs, the strobe is lost, and the thread sets it dark
// and then up again by itself, also while the strobe is stopped. A set-up that is refused ends with every output at 0
// percent, as the destructor does: over a new connection, if the old one fails. For the state after a kill see
// set_dark().
//
// The manual says of no command that a trigger was taken. The controller ignores one that comes within its retrigger
// delay, or while it protects the light: only the frame shows that.
#pragma once

#include <memory>

#include "drivers/gardasoft/gardasoft_options.h"
#include "drivers/hal/event_loop.h"
#include "drivers/hal/light_budget.h"
#include "drivers/hal/strobe.h"

namespace hord::drivers {

class GardasoftStrobe final : public hal::Strobe {
  public:
    static constexpr std::size_t kMaxPending = 64;  // pulses accepted and not yet begun
    static constexpr hal::Duration kCheckEvery = std::chrono::milliseconds(200);
    // No check begins this short before a pulse.
    static constexpr hal::Duration kCheckMargin = std::chrono::milliseconds(10);
    static constexpr hal::Duration kRetryEvery = std::chrono::milliseconds(250);  // a lost controller is tried again

    // Loop thread; blocks until the controller is set up. `loop` runs in real time and outlives the driver. `trigger`:
    // channel k lights output k of it, whose pulses drive the controller's inputs; null: the command "TR".
    // Fails with invalid_argument (all that is wrong with the options), as GardasoftLink does, and with refused when
    // the controller does not hold a setting.
    static Result<std::unique_ptr<GardasoftStrobe>> open(hal::EventLoop& loop, GardasoftStrobeOptions options,
                                                         std::unique_ptr<hal::Strobe> trigger = nullptr);
    ~GardasoftStrobe() override;

    // max_on is the pulse that the controller is set to. fire() refuses a pulse of another width (invalid_argument).
    [[nodiscard]] hal::StrobeLimits limits() const override;

    // Of the trigger: what the strobe that drives the controller's inputs must allow, for one channel.
    static hal::LightLimits trigger_limits(const GardasoftChannel& channel, const GardasoftStrobeOptions& options);

  private:
    struct Worker;
    GardasoftStrobe(std::shared_ptr<Worker> worker, std::unique_ptr<hal::Strobe> trigger);
    Result<void> do_start(Listener& listener) override;
    Result<void> do_fire(const hal::StrobePulse& pulse) override;
    void do_stop() override;

    std::shared_ptr<Worker> worker_;
    std::unique_ptr<hal::Strobe> trigger_;
    hal::LightBudget planned_;
};

// Sets every output to 0 percent, on a connection of its own: for a station that has died. Blocks for some
// response_timeout. Fails as GardasoftLink does.
Result<void> set_dark(const GardasoftStrobeOptions& options);

// What the controller says of itself ("RT420-20 (HW02) V031"). Changes nothing; blocks. Fails as GardasoftLink does.
Result<std::string> identify(const GardasoftStrobeOptions& options);

}  // namespace hord::drivers
