// The collimator LEDs.
#pragma once

#include <cstdint>

#include "drivers/hal/clock.h"
#include "drivers/hal/device.h"

namespace hord::hal {

// What the lights withstand. The driver enforces it.
struct StrobeLimits {
    Duration max_on{};    // longest pulse
    Duration min_rest{};  // shortest time from the end of a pulse to the start of the next
    int channels = 1;     // 1..32
};

struct StrobePulse {
    std::uint32_t exposure = 0;  // repeated in the report
    std::uint32_t channels = 1;  // bit set of collimators
    TimePoint start;
    Duration width{};
};

struct StrobeReport {
    std::uint32_t exposure = 0;
    bool lit = false;  // false: refused, late or failed; the frame is dark or wrongly lit
    TimePoint start;   // the measured one
    Duration width{};  // the measured one
};

class StrobeListener {
  public:
    virtual void on_strobe(const StrobeReport& report) = 0;  // exactly one for every accepted fire()
    virtual void on_strobe_lost(const Error& error) = 0;

  protected:
    ~StrobeListener() = default;
};

// Lights are off when start() returns, also after a failure. stop() turns all lights off at once; pulses not yet begun
// are dropped and reported as not lit.
class Strobe : public Device<StrobeListener> {
  public:
    // Loop thread, does not block. Schedules one pulse.
    // Fails with invalid_argument (no such channel, width not in (0, max_on]), busy (inside min_rest of a pulse
    // already accepted), disconnected (not started or lost). After a failure nothing is lit.
    Result<void> fire(const StrobePulse& pulse);

    [[nodiscard]] virtual StrobeLimits limits() const = 0;

  protected:
    Strobe() : Device("the strobe") {}

  private:
    virtual Result<void> do_fire(const StrobePulse& pulse) = 0;
    TimePoint busy_until_{};
    bool ever_fired_ = false;
};

}  // namespace hord::hal
