#include "hal_sim/devices/sim_strobe.h"

#include <algorithm>

namespace hord::sim {

using hal::Duration;
using hal::TimePoint;
using namespace std::chrono_literals;

SimStrobe::~SimStrobe() {
    listener_ = nullptr;  // it may be destroyed already: no report to it
    stop();
}

Result<void> SimStrobe::do_start(Listener& listener) {
    dark_from(loop_.now());
    if (loop_.now() < back_at_)
        return fail(ErrorCode::not_found, "simulated strobe is gone", "start it again when it is back");
    listener_ = &listener;
    lost_ = false;
    return {};
}

Result<void> SimStrobe::do_fire(const hal::StrobePulse& pulse) {
    if (lost_) return fail(ErrorCode::disconnected, "simulated strobe is gone", "stop it and start it again");
    if (const auto amount = faults_.fires(InjectedFault::strobe_lost)) {
        lose(*amount);
        return fail(ErrorCode::disconnected, "simulated strobe is gone", "stop it and start it again");
    }
    const bool refused = faults_.fires(InjectedFault::strobe_refused).has_value(),
               dead = faults_.fires(InjectedFault::strobe_dead).has_value(),
               weak = faults_.fires(InjectedFault::strobe_weak).has_value();
    const auto again_after = faults_.fires(InjectedFault::strobe_double),
               late_by = faults_.fires(InjectedFault::strobe_late),
               shorter_by = faults_.fires(InjectedFault::strobe_short);
    const TimePoint now = loop_.now();
    hal::StrobeReport done{pulse.exposure, true, std::max(pulse.start, now) + late_by.value_or(0ns),
                           pulse.width - std::min(pulse.width, shorter_by.value_or(0ns))};
    if (now >= pulse.start + pulse.width || refused) {
        done.lit = false;
        done.width = {};
    } else if (!dead) {
        const double brightness = weak ? 0.25 : 1;
        light(done.start, done.width, brightness);
        if (again_after) light(done.start + done.width + *again_after, done.width, brightness);
    }
    pending_.add(done.start + done.width + latency_.next(), done);
    return {};
}

void SimStrobe::light(TimePoint from, Duration width, double brightness) {
    while (!lit_.empty() && lit_.front().until + 1s < loop_.now()) lit_.pop_front();
    lit_.push_back({from, from + width, brightness});
    longest_on_ = std::max(longest_on_, width);
}

void SimStrobe::dark_from(TimePoint at) {
    std::erase_if(lit_, [&](const Lit& lit) { return lit.from >= at; });
    for (Lit& lit : lit_) lit.until = std::min(lit.until, at);
}

SimStrobe::Light SimStrobe::light_between(TimePoint from, TimePoint until) const {
    Light out{0, TimePoint::max()};
    for (const Lit& lit : lit_) {
        const TimePoint begin = std::max(lit.from, from), end = std::min(lit.until, until);
        if (end <= begin) continue;
        const double share =
            static_cast<double>((end - begin).count()) / static_cast<double>(options_.nominal_pulse.count());
        out.amount += share * lit.brightness;
        out.at = std::min(out.at, begin + (end - begin) / 2);
    }
    return out;
}

void SimStrobe::lose(Duration gone_for) {
    lost_ = true;
    back_at_ = loop_.now() + gone_for;
    dark_from(loop_.now());
    lost_timer_ = loop_.call_after({}, [this] {
        // Accepted pulses are reported as not lit before the loss.
        pending_.drop([this](hal::StrobeReport& done) {
            done.lit = false;
            listener_->on_strobe(done);
        });
        if (listener_ == nullptr) return;  // one of them stopped the device
        listener_->on_strobe_lost({ErrorCode::disconnected, "simulated strobe is gone", "stop it and start it again"});
    });
}

void SimStrobe::do_stop() {
    const TimePoint now = loop_.now();
    dark_from(now);
    loop_.cancel(lost_timer_);
    Listener* listener = std::exchange(listener_, nullptr);
    pending_.drop([&](hal::StrobeReport& done) {
        if (done.lit && done.start < now) done.width = std::min(done.width, now - done.start);  // cut short
        else done.lit = false;
        if (!done.lit) done.width = {};
        if (listener != nullptr) listener->on_strobe(done);
    });
}

}  // namespace hord::sim
