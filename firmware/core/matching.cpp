// Assigns frames, strobe reports and judgements to parts, and detects those that belong to no part.
#include <algorithm>

#include "firmware/core/core.h"

namespace hord::firmware {
namespace {

std::uint32_t trouble_of(PartReason reason) {
    switch (reason) {
        case PartReason::verdict_late: return kFaultOverrun;
        case PartReason::frame_lost:
        case PartReason::frame_stale:
        case PartReason::frame_duplicate:
        case PartReason::frame_short:
        case PartReason::frame_corrupt: return kFaultSensor;
        case PartReason::strobe_failed: return kFaultStrobe;
        case PartReason::inspector_failed: return kFaultInspector;
        case PartReason::too_dark:
        case PartReason::saturated: return kFaultLightLevel;
        default: return 0;
    }
}

bool differs_by_more(Duration a, Duration b, Duration tolerance) { return a - b > tolerance || b - a > tolerance; }

std::uint32_t to_us(Duration d) {
    const auto us = std::chrono::duration_cast<std::chrono::microseconds>(d).count();
    return static_cast<std::uint32_t>(std::clamp<std::int64_t>(us, 0, 0xFFFFFFFE));
}

}  // namespace

// One frame a part. A second frame in a part's window makes it unfit: nobody knows which of the two shows it. A frame
// that answers a part's trigger outside its window makes it unfit, too: it has used up the trigger, and no other comes.
// Another stray frame is noted on the oldest part that waits for its frame: if that one never comes, the stray frame's
// kind is the reason.
void Core::on(const FrameArrived& event) {
    const std::uint32_t step = event.info.sequence - last_frame_;
    const bool repeated = frames_seen_ && (step == 0 || step >= (1U << 31));
    if (!repeated) {
        frames_seen_ = true;
        last_frame_ = event.info.sequence;
    }
    Part* part = repeated ? nullptr : owner_of(event.info);
    if (part == nullptr || !part->frame_due || event.info.nobodys) {
        actions_->push(ReleaseFrame{event.frame});
        if (part != nullptr && !part->frame_due) decide(*part, PartVerdict::unfit, PartReason::frame_duplicate);
        if (!repeated && event.info.exposure != 0)
            return refused(event.info.exposure, &Part::frame_due, PartReason::frame_stale);
        return note_stray_frame(repeated ? PartReason::frame_duplicate : PartReason::frame_stale);
    }
    part->frame_due = false;
    if (part->phase != Part::Phase::waiting) {  // already rejected for another reason
        actions_->push(ReleaseFrame{event.frame});
    } else if (event.info.corrupt || event.info.bytes_used < config_.frame_bytes) {
        actions_->push(ReleaseFrame{event.frame});
        decide(*part, PartVerdict::unfit, event.info.corrupt ? PartReason::frame_corrupt : PartReason::frame_short);
    } else {
        part->inspecting = true;
        actions_->push(Inspect{part->number(), event.frame});
    }
}

// The part whose exposure was requested at the frame's time stamp, and not after it; where the device knows whose
// trigger made the frame, that part alone. A part that still waits for its frame goes before one that has it.
Part* Core::owner_of(const hal::FrameInfo& frame) {
    Part* has_one = nullptr;
    for (std::uint32_t k = 0; k < line_.size(); ++k) {
        Part& part = line_[k];
        if (!part.exposed || frame.exposure_start < part.asked_at) continue;
        if (frame.exposure != 0 && frame.exposure != part.number()) continue;
        if (differs_by_more(frame.exposure_start.time_since_epoch(), part.exposure_start.time_since_epoch(),
                            config_.frame_window)) {
            continue;
        }
        if (part.frame_due) return &part;
        has_one = &part;
    }
    return has_one;
}

void Core::note_stray_frame(PartReason stray_frame) {
    for (std::uint32_t k = 0; k < line_.size(); ++k) {
        Part& part = line_[k];
        if (part.phase != Part::Phase::waiting || !part.frame_due) continue;
        if (part.stray_frame == PartReason::none) part.stray_frame = stray_frame;
        return;
    }
}

void Core::on(const hal::StrobeReport& report) {
    Part* part = line_.find(report.exposure);
    if (part == nullptr || !part->light_due) return;
    part->light_due = false;
    if (part->phase != Part::Phase::waiting) return;
    const TimePoint asked = part->exposure_start + config_.strobe_delay;
    if (!report.lit || differs_by_more(report.start - TimePoint{}, asked - TimePoint{}, config_.strobe_window) ||
        differs_by_more(report.width, config_.strobe, config_.strobe_window)) {
        return decide(*part, PartVerdict::unfit, PartReason::strobe_failed);
    }
    part->light_good = true;
}

void Core::on(const Judged& judged) {
    Part* part = line_.find(judged.part);
    if (part == nullptr || !part->inspecting) return;
    part->inspecting = false;
    if (part->phase != Part::Phase::waiting) return;  // too late, or rejected for another reason
    if (judged.failed) return decide(*part, PartVerdict::unfit, PartReason::inspector_failed);
    part->judged = true;
    part->judgement = judged;
}

// The judgement counts only when light and position were right, and before the deadline. settle() asks in each step.
void Core::judge_when_complete(Part& part) {
    if (!part.judged || !part.light_good || !part.place_good) return;
    if (now_ >= at_ejector(part) - config_.reject_early - config_.reject_lead) {
        return decide(part, PartVerdict::unfit, PartReason::verdict_late);
    }
    ++counters_.inspected;
    part.result.defects = part.judgement.defects;
    part.result.score = part.judgement.score;
    part.result.position_m = part.judgement.position_m;
    part.result.position_n = part.judgement.position_n;
    part.result.recipe = part.judgement.recipe;
    part.result.bounded = part.judgement.bounded;
    const auto reason = static_cast<PartReason>(part.judgement.reason);
    switch (part.judgement.verdict) {
        case algo::Verdict::pass: return decide(part, PartVerdict::pass, PartReason::none);
        case algo::Verdict::reject: return decide(part, PartVerdict::reject, reason);
        case algo::Verdict::unfit: return decide(part, PartVerdict::unfit, reason);
    }
}

// A device refused to do what `pending` waits for.
void Core::refused(std::uint32_t number, bool Part::*pending, PartReason reason) {
    Part* part = line_.find(number);
    if (part == nullptr || !(part->*pending)) return;
    part->*pending = false;
    decide(*part, PartVerdict::unfit, reason);
}

// The one place where a part gets its verdict; one that has it keeps it.
void Core::decide(Part& part, PartVerdict verdict, PartReason reason) {
    if (part.phase != Part::Phase::waiting) return;
    part.phase = Part::Phase::decided;
    part.result.verdict = verdict;
    part.result.reason = reason;
    part.result.latency_us = to_us(now_ - part.arrived);
    switch (verdict) {
        case PartVerdict::pass: ++counters_.pass; break;
        case PartVerdict::reject: ++counters_.reject; break;
        case PartVerdict::unfit: ++counters_.unfit; break;
    }
    if (part.accepted) count_trouble(reason);
    if (verdict == PartVerdict::pass) complete(part, RejectState::not_needed);
}

// Raises the fault of a part without a judgement. Several such parts in a row lead to Error: the station is at fault,
// not the parts.
void Core::count_trouble(PartReason reason) {
    const std::uint32_t trouble = trouble_of(reason);
    if (trouble != 0) {
        keep_active(trouble);
        ++failures_in_a_row_;
        if (config_.max_failures_in_a_row != 0 && failures_in_a_row_ >= config_.max_failures_in_a_row)
            go(Trigger::fault);
    } else if (is_judged(reason)) {  // every device on the way works
        trouble_ &= ~std::uint32_t{kFaultOverrun | kFaultSensor | kFaultStrobe | kFaultInspector | kFaultLightLevel};
        failures_in_a_row_ = 0;
    }
}

}  // namespace hord::firmware
