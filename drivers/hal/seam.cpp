// The public functions of the device interfaces: preconditions, checked once for all backends.
#include "drivers/hal/rejector.h"
#include "drivers/hal/sensor.h"
#include "drivers/hal/strobe.h"

namespace hord::hal {

Result<void> Strobe::fire(const StrobePulse& pulse) {
    if (!is_started()) return not_started();
    const StrobeLimits limits = this->limits();
    const std::uint32_t known = limits.channels >= 32 ? ~0U : (1U << limits.channels) - 1U;
    if (pulse.channels == 0 || (pulse.channels & ~known) != 0) {
        return fail(ErrorCode::invalid_argument, "strobe pulse names a channel that does not exist",
                    "use channels below " + std::to_string(limits.channels));
    }
    if (pulse.width <= Duration::zero() || pulse.width > limits.max_on) {
        return fail(ErrorCode::invalid_argument,
                    "strobe pulse of " + std::to_string(pulse.width.count()) + " ns is outside (0, " +
                        std::to_string(limits.max_on.count()) + "] ns",
                    "shorten the pulse; the limit protects the LED");
    }
    if (ever_fired_ && pulse.start < busy_until_ + limits.min_rest) {
        return fail(ErrorCode::busy, "strobe pulse starts before the light has rested",
                    "space the parts or shorten the pulse");
    }
    auto done = do_fire(pulse);
    if (done) {
        busy_until_ = pulse.start + pulse.width;
        ever_fired_ = true;
    }
    return done;
}

void FrameLease::GiveBack::operator()(Sensor* owner) const noexcept { owner->do_give_back(slot); }

Result<void> Sensor::trigger(const ExposureRequest& request) {
    if (!is_started()) return not_started();
    if (request.length <= Duration::zero()) {
        return fail(ErrorCode::invalid_argument, "exposure length must be positive", "set timing.exposure_us above 0");
    }
    return do_trigger(request);
}

Result<void> Rejector::reject(const RejectCommand& command) {
    if (!is_started()) return not_started();
    if (command.width <= Duration::zero()) {
        return fail(ErrorCode::invalid_argument, "reject pulse width must be positive",
                    "set rejector.pulse_ms above 0");
    }
    return do_reject(command);
}

void Rejector::set_run_permit(bool permit) {
    if (is_started()) do_set_run_permit(permit);
}

}  // namespace hord::hal
