#include "drivers/camera_process/camera_strobe.h"

#include <algorithm>
#include <utility>

namespace hord::drivers {

using hal::Duration;
using hal::StrobePulse;
using hal::StrobeReport;
using hal::TimePoint;

CameraStrobe::CameraStrobe(hal::EventLoop& loop, CameraPortSensor& camera, const hal::LightLimits& limits,
                           Duration exposure)
    : loop_(loop), camera_(camera), limits_(limits), exposure_(exposure), planned_({limits}), spent_({limits}) {
    camera_.tell_exposures(this);
}

CameraStrobe::~CameraStrobe() {
    listener_ = nullptr;  // the listener may not exist any more
    stop();
    camera_.tell_exposures(nullptr);
}

hal::StrobeLimits CameraStrobe::limits() const { return {exposure_, limits_.min_rest, 1}; }

Result<void> CameraStrobe::do_start(Listener& listener) {
    listener_ = &listener;
    lost_ = false;
    return {};
}

Result<void> CameraStrobe::do_fire(const StrobePulse& pulse) {
    if (lost_ || !camera_.streams())
        return fail(ErrorCode::disconnected, "the camera that lights does not stream",
                    "start the sensor; after a loss stop and start both again");
    if (pulse.width != exposure_) {
        return fail(ErrorCode::invalid_argument,
                    "strobe pulse of " + std::to_string(pulse.width.count()) + " ns; the camera exposes for " +
                        std::to_string(exposure_.count()) + " ns",
                    "set timing.strobe_us and start the station again");
    }
    if (auto checked = planned_.check(1, pulse.start, pulse.width); !checked) return checked;
    if (pending_.size() >= kMaxPending)
        return fail(ErrorCode::busy, "too many strobe pulses are waiting", "ask for them later");
    planned_.spend(1, pulse.start, pulse.width);
    pending_.push_back(pulse);
    plan();
    return {};
}

// When the next pulse may begin: it is due and the light has rested. While the frame of the one before has not come,
// nobody knows when that is: the pulse waits until its own end.
TimePoint CameraStrobe::next_at() const {
    const auto next = std::ranges::min_element(pending_, {}, &StrobePulse::start);
    return triggered_ ? next->start + next->width : std::max(next->start, spent_.rested(1));
}

void CameraStrobe::plan() {
    loop_.cancel(next_timer_);
    if (!pending_.empty() && listener_ != nullptr) next_timer_ = loop_.call_at(next_at(), [this] { step(); });
}

void CameraStrobe::step() {
    if (pending_.empty() || next_at() > loop_.now()) return plan();
    const auto next = std::ranges::min_element(pending_, {}, &StrobePulse::start);
    const StrobePulse pulse = *next;
    pending_.erase(next);
    begin(pulse);
    plan();
}

void CameraStrobe::begin(const StrobePulse& pulse) {
    const TimePoint now = loop_.now();
    if (now >= pulse.start + pulse.width) return report_not_lit(pulse);
    triggered_ = Triggered{pulse, now};
    frame_timer_ = loop_.call_after(exposure_ + kPatience, [this] { give_up_on_frame(); });
    if (const auto done = camera_.expose(pulse.exposure); !done) give_up_on_frame();
}

// Lit at an unknown time, or not at all: it rests as if it had just ended.
void CameraStrobe::give_up_on_frame() {
    loop_.cancel(frame_timer_);
    const auto triggered = std::exchange(triggered_, std::nullopt);
    if (!triggered) return;
    spent_.spend(1, loop_.now() - exposure_, exposure_);
    report_not_lit(triggered->pulse);
    plan();
}

void CameraStrobe::on_exposure(const CameraFrame& frame) {
    if (!triggered_) return;
    loop_.cancel(frame_timer_);
    const Triggered triggered = *std::exchange(triggered_, std::nullopt);
    // A frame of an earlier trigger, which was given up, has an earlier time.
    const bool known = frame.stamp_of_start && frame.stamp >= triggered.sent && frame.stamp <= loop_.now();
    if (!known) {
        triggered_ = triggered;
        return give_up_on_frame();
    }
    spent_.spend(1, frame.stamp, exposure_);
    plan();
    report_later({.exposure = triggered.pulse.exposure, .lit = true, .start = frame.stamp, .width = exposure_});
}

void CameraStrobe::report_later(const StrobeReport& report) {
    exposing_ = report;
    report_timer_ = loop_.call_at(report.start + report.width, [this] {
        const StrobeReport done = *std::exchange(exposing_, std::nullopt);
        if (listener_ != nullptr) listener_->on_strobe(done);
    });
}

void CameraStrobe::report_not_lit(const StrobePulse& pulse) {
    if (listener_ != nullptr)
        listener_->on_strobe({.exposure = pulse.exposure, .lit = false, .start = loop_.now(), .width = {}});
}

void CameraStrobe::on_camera_lost(const Error& error) {
    if (listener_ == nullptr || std::exchange(lost_, true)) return;
    loop_.cancel(next_timer_);
    give_up_on_frame();
    for (const StrobePulse& pulse : std::exchange(pending_, {})) report_not_lit(pulse);
    if (listener_ != nullptr) listener_->on_strobe_lost(error);
}

void CameraStrobe::do_stop() {
    if (const auto done = std::exchange(exposing_, std::nullopt); done && listener_ != nullptr)
        listener_->on_strobe(*done);
    give_up_on_frame();
    for (const StrobePulse& pulse : std::exchange(pending_, {})) report_not_lit(pulse);
    listener_ = nullptr;
    for (const auto timer : {next_timer_, frame_timer_, report_timer_}) loop_.cancel(timer);
}

}  // namespace hord::drivers
