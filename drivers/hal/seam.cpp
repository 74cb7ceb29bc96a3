// The public functions of the device interfaces: preconditions, checked once for all backends.
#include "drivers/hal/part_sensor.h"
#include "drivers/hal/rejector.h"
#include "drivers/hal/sensor.h"
#include "drivers/hal/strobe.h"

namespace hord::hal {
namespace {

template <class Start>
Result<void> start_once(bool& started, const char* what, Start do_start) {
    if (started) return fail(ErrorCode::invalid_argument, std::string(what) + " is already started", "stop it first");
    Result<void> done = do_start();
    started = done.has_value();
    return done;
}
tl::unexpected<Error> not_started(const char* what) {
    return fail(ErrorCode::disconnected, std::string(what) + " is not started", "start it and wait for its link");
}

}  // namespace

Result<void> PartSensor::start(Listener& listener) {
    return start_once(started_, "the part sensor", [&] { return do_start(listener); });
}

void PartSensor::stop() {
    if (std::exchange(started_, false)) do_stop();
}

Result<void> Strobe::start(Listener& listener) {
    return start_once(started_, "the strobe", [&] { return do_start(listener); });
}

Result<void> Strobe::fire(const StrobePulse& pulse) {
    if (!started_) return not_started("the strobe");
    const StrobeLimits limits = do_limits();
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

void Strobe::stop() {
    if (std::exchange(started_, false)) do_stop();
}

void FrameLease::give_back() noexcept {
    if (Sensor* owner = std::exchange(owner_, nullptr)) owner->do_give_back(slot_);
}

Result<void> Sensor::start(Listener& listener) {
    return start_once(started_, "the sensor", [&] { return do_start(listener); });
}

Result<void> Sensor::trigger(const ExposureRequest& request) {
    if (!started_) return not_started("the sensor");
    if (request.length <= Duration::zero()) {
        return fail(ErrorCode::invalid_argument, "exposure length must be positive", "set timing.exposure_us above 0");
    }
    return do_trigger(request);
}

void Sensor::stop() {
    if (std::exchange(started_, false)) do_stop();
}

Result<void> Rejector::start(Listener& listener) {
    return start_once(started_, "the rejector", [&] { return do_start(listener); });
}

Result<void> Rejector::reject(const RejectCommand& command) {
    if (!started_) return not_started("the rejector");
    if (command.width <= Duration::zero()) {
        return fail(ErrorCode::invalid_argument, "reject pulse width must be positive",
                    "set rejector.pulse_ms above 0");
    }
    return do_reject(command);
}

void Rejector::set_run_permit(bool permit) {
    if (started_) do_set_run_permit(permit);
}

void Rejector::stop() {
    if (std::exchange(started_, false)) do_stop();
}

}  // namespace hord::hal
