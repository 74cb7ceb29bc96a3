// At the ejector: the verdict's deadline, the reject command, its confirmation, and the part's result.
#include <algorithm>

#include "firmware/core/core.h"

namespace hord::firmware {

TimePoint Core::at_ejector(const Part& part) const {
    if (!config_.by_encoder) return part.arrived + config_.transport;
    return part.passed_ejector != TimePoint::max() ? part.passed_ejector : conveyor_.reaches(part.target_counts);
}

// When a part has passed the ejector.
TimePoint Core::gone_at(const Part& part) const {
    const TimePoint at = config_.by_encoder ? part.passed_ejector : part.arrived + config_.transport;
    return at == TimePoint::max() || at == TimePoint::min() ? at : at + config_.reject_pulse;
}

// Does what is due now for every part, and sets next_wake_.
void Core::settle() {
    next_wake_ = next_heartbeat_;
    if (config_.by_encoder && config_.encoder_timeout > Duration::zero() && line_.size() > 0) {
        const TimePoint silent_at = std::max(conveyor_.last_read(), line_[0].arrived) + config_.encoder_timeout;
        if (now_ >= silent_at && line_[0].passed_ejector != TimePoint::min()) {
            keep_active(kFaultPartSensor);
            lose_position();
            stop_the_line({LineStopCause::encoder_silent});
        } else {
            next_wake_ = std::min(next_wake_, silent_at);
        }
    }
    if (covered_ && leaves_seen_ && !config_.by_encoder && config_.max_part > Duration::zero()) {
        look_for_touching_parts(now_, 0);
        if (covered_) next_wake_ = std::min(next_wake_, covered_since_ + config_.max_part + Duration(1));
    }
    if (state_ == State::initialized && now_ < ejector_rests_at_) next_wake_ = std::min(next_wake_, ejector_rests_at_);
    for (std::uint32_t k = 0; k < line_.size(); ++k) {
        if (actions_->room() < 8) {  // the rest in the next step, which is due at once
            next_wake_ = now_;
            return;
        }
        next_wake_ = std::min(next_wake_, settle(line_[k]));
    }
    while (line_.size() > 0 && line_[0].phase == Part::Phase::complete && now_ >= gone_at(line_[0])) {
        if (line_[0].accepted) --accepted_on_line_;
        line_.pop_oldest();
    }
    if (line_.size() > 0 && line_[0].phase == Part::Phase::complete)
        next_wake_ = std::min(next_wake_, gone_at(line_[0]));

    const bool taken_all = draining_ || (state_ == State::single_execution && single_taken_);
    if (executing(state_) && taken_all && accepted_on_line_ == 0) go(Trigger::finished);
}

// Does what is due for one part. Returns when something is due next without an event.
TimePoint Core::settle(Part& part) {
    TimePoint next = TimePoint::max();
    if (part.phase == Part::Phase::waiting && !part.exposed) next = expose_when_due(part);
    if (part.phase == Part::Phase::waiting) judge_when_complete(part);
    if (part.phase == Part::Phase::waiting && (part.frame_due || part.light_due)) {
        const TimePoint lost_at = part.exposure_start + config_.exposure + config_.frame_timeout;
        if (now_ < lost_at) {
            next = lost_at;
        } else if (part.frame_due) {
            decide(part, PartVerdict::unfit,
                   part.stray_frame != PartReason::none ? part.stray_frame : PartReason::frame_lost);
        } else {
            decide(part, PartVerdict::unfit, PartReason::strobe_failed);
        }
    }
    if ((part.abandoned || ends_) && part.phase != Part::Phase::complete) {
        if (part.phase == Part::Phase::decided) ++counters_.reject_commanded;
        complete(part, RejectState::failed);
    }
    if (part.phase == Part::Phase::waiting || part.phase == Part::Phase::decided) {
        const TimePoint at = at_ejector(part);
        const TimePoint deadline =
            at == TimePoint::max() || at == TimePoint::min() ? at : at - config_.reject_early - config_.reject_lead;
        if (now_ < deadline) return std::min(next, deadline);
        decide(part, PartVerdict::unfit, PartReason::verdict_late);
        command_reject(part);
    }
    return part.phase == Part::Phase::commanded ? await_report(part) : TimePoint::max();
}

void Core::command_reject(Part& part) {
    ++counters_.reject_commanded;
    const TimePoint at = at_ejector(part);
    if (at == TimePoint::min() || !up(Device::rejector)) return complete(part, RejectState::failed);
    part.eject_start = at - config_.reject_early;
    if (now_ >= part.eject_start + config_.reject_pulse)
        return complete(part, RejectState::late);  // it would hit a neighbour
    part.phase = Part::Phase::commanded;
    part.command_late = now_ > at;
    ejector_rests_at_ = std::max(ejector_rests_at_, part.eject_start + config_.reject_pulse);
    actions_->push(hal::RejectCommand{part.number(), part.eject_start, config_.reject_pulse});
}

void Core::on(const hal::RejectReport& report) {
    Part* part = line_.find(report.part);
    if (part == nullptr || part->phase != Part::Phase::commanded || part->reported) return;
    part->reported = true;
    part->report = report;
}

void Core::on(const RejectRefused& event) {
    Part* part = line_.find(event.part);
    if (part != nullptr && part->phase == Part::Phase::commanded) complete(*part, RejectState::failed);
}

// A rejection is confirmed if the rejector acknowledged it before the part reached the ejector and, with an encoder,
// the part was there during the pulse. After a later acknowledgement the pulse may have begun behind the part.
TimePoint Core::await_report(Part& part) {
    using Outcome = hal::RejectReport::Outcome;
    const TimePoint pulse_end = part.eject_start + config_.reject_pulse;
    const TimePoint give_up = pulse_end + config_.confirm_timeout;
    if (part.reported && (part.report.outcome == Outcome::failed || part.place_lost)) {
        complete(part, RejectState::failed);
    } else if (part.reported &&
               (part.command_late || part.report.outcome == Outcome::late || part.report.at > pulse_end)) {
        complete(part, RejectState::late);
    } else if (config_.by_encoder && part.passed_ejector == TimePoint::max()) {
        if (now_ < pulse_end + config_.encoder_timeout) return pulse_end + config_.encoder_timeout;
        complete(part, RejectState::late);  // the conveyor stood: the pulse is over, the part is not there yet
    } else if (config_.by_encoder && (part.passed_ejector < part.eject_start || part.passed_ejector > pulse_end)) {
        complete(part, RejectState::late);
    } else if (part.reported && part.report.at > at_ejector(part)) {
        complete(part, RejectState::late);
    } else if (part.reported) {
        complete(part, RejectState::confirmed);
    } else if (now_ >= give_up) {
        complete(part, RejectState::failed);
    } else {
        return give_up;
    }
    return TimePoint::max();
}

void Core::complete(Part& part, RejectState outcome) {
    part.phase = Part::Phase::complete;
    part.result.reject = outcome;
    switch (outcome) {
        case RejectState::confirmed:
            ++counters_.reject_confirmed;
            part.result.reject_latency_us = static_cast<std::uint32_t>(
                std::clamp<std::int64_t>((part.report.at - part.arrived).count() / 1000, 1, 0xFFFFFFFE));
            break;
        case RejectState::failed: ++counters_.reject_failed; break;
        case RejectState::late: ++counters_.reject_late; break;
        case RejectState::not_needed:
        case RejectState::commanded: break;
    }
    record(part.result);
    const bool unconfirmed = outcome == RejectState::failed || outcome == RejectState::late;
    if (unconfirmed && !part.abandoned) {
        const bool late = outcome == RejectState::late;
        stop_the_line({late ? LineStopCause::reject_late : LineStopCause::reject_failed, part.number()});
    }
}

void Core::record(PartResult& result) {
    result.sequence = ++results_;
    last_ = result;
    actions_->push(result);
}

}  // namespace hord::firmware
