// From the part sensor's edge to the exposure: numbers the part, decides whether it is inspected, and when.
#include <algorithm>

#include "firmware/core/core.h"

namespace hord::firmware {

// True if `edge` follows the last one: next sequence number, time not before the last edge and not in the future. Lost
// edges may hide parts; then the line is stopped.
bool Core::continues(const hal::PartEdge& edge) {
    const bool in_time = edge.at >= last_edge_at_ && edge.at <= now_;
    const std::uint32_t step = edge.sequence - last_edge_;
    if (step == 1) return in_time;
    if (step > 1 && step < (1U << 31)) {
        // Edges alternate: arrives, leaves. With a sensor that reports arrivals only, every lost edge is a lost part.
        // An edge made by noise breaks the alternation: then the edges before and behind the lost ones do not fit
        // together, and an odd one among the lost counts as an arrival.
        const std::uint32_t lost = step - 1;
        const bool first_lost_arrives = last_kind_ == hal::PartEdge::Kind::leaves;
        const bool last_lost_arrives = edge.kind == hal::PartEdge::Kind::leaves;
        const std::uint32_t odd = first_lost_arrives || last_lost_arrives ? 1 : 0;
        const std::uint32_t parts = !leaves_seen_ ? lost : (lost + odd) / 2;
        counters_.missed += parts;
        keep_active(kFaultPartSensor);
        if (parts > 0) stop_the_line({LineStopCause::part_sensor_lost});
    }
    return false;
}

void Core::on(const hal::PartEdge& edge) {
    if (edge.sequence == last_edge_ && edge.at == last_edge_at_ && last_edge_ != 0)
        return;  // a repeated report of the same edge
    const bool arrives = edge.kind == hal::PartEdge::Kind::arrives;
    const bool certain = continues(edge);
    if (!arrives && last_edge_ == 0 && certain && started_) part_was_there();
    last_edge_ = edge.sequence;
    last_kind_ = edge.kind;
    last_edge_at_ = edge.at;
    leaves_seen_ = leaves_seen_ || !arrives;
    if (edge.counts) on(hal::EncoderReading{edge.at, *edge.counts});
    const bool counted = edge.counts && Conveyor::plausible(*edge.counts);
    const std::int64_t counts = counted ? *edge.counts : conveyor_.counts_at(edge.at);
    if (!arrives) look_for_touching_parts(edge.at, counts);
    if (arrives && !(covered_ && certain)) {  // an arrival on a covered sensor does not restart its time
        covered_since_ = std::min(edge.at, now_);
        covered_since_counts_ = counts;
    }
    // Without an encoder a part on a belt that may stand covers the sensor for as long as the belt stands.
    covered_ = arrives && (config_.by_encoder || belt_runs_since(edge.at));
    if (arrives) arrive(edge, certain);
}

// The first edge is `leaves`: an unknown part covered the part sensor when it came up.
void Core::part_was_there() {
    ++counters_.missed;
    keep_active(kFaultPartSensor);
    stop_the_line({LineStopCause::untracked_part});
}

// The part sensor is covered for longer than any part takes: a second part touches the newest one. Its position is
// unknown, so it cannot be rejected: the line is stopped.
void Core::look_for_touching_parts(TimePoint at, std::int64_t counts) {
    if (!covered_ || !leaves_seen_) return;
    const bool by_counts = config_.by_encoder;
    const bool too_long = by_counts
        ? config_.max_part_counts > 0 && counts - covered_since_counts_ > config_.max_part_counts
        : config_.max_part > Duration::zero() && at - covered_since_ > config_.max_part;
    if (!too_long) return;
    covered_ = false;
    ++counters_.missed;
    keep_active(kFaultPartSensor);
    if (line_.size() > 0) decide(line_[line_.size() - 1], PartVerdict::unfit, PartReason::parts_too_close);
    stop_the_line({LineStopCause::untracked_part});
}

void Core::arrive(const hal::PartEdge& edge, bool identity_certain) {
    ++counters_.seen;
    const std::uint32_t number = ++parts_;
    const TimePoint arrived = identity_certain ? edge.at : std::min(edge.at, now_);
    if (line_.full()) {  // it cannot be tracked, so it cannot be rejected
        PartResult result;
        result.part = number;
        result.arrived_ns = arrived.time_since_epoch().count();
        result.reason = PartReason::line_full;
        result.reject = RejectState::failed;
        ++counters_.unfit;
        ++counters_.reject_commanded;
        ++counters_.reject_failed;
        record(result);
        stop_the_line({LineStopCause::untracked_part, number});
        return;
    }
    const bool counted = edge.counts && Conveyor::plausible(*edge.counts);
    const std::int64_t counts = counted ? *edge.counts : conveyor_.counts_at(arrived);
    const bool too_close = comes_too_close(arrived, counts);
    last_arrival_ = arrived;
    last_arrival_counts_ = counts;
    Part& part = line_.append();
    part.arrived = arrived;
    part.edge_counts = counts;
    part.target_counts = counts + config_.transport_counts;
    part.exposure_start = config_.by_encoder ? TimePoint::max() : arrived + config_.exposure_delay;
    part.abandoned = looked_after_since(arrived);
    part.place_lost = part.abandoned || (!config_.by_encoder && !belt_runs_since(arrived));
    part.result.part = number;
    part.result.arrived_ns = arrived.time_since_epoch().count();

    if (part.abandoned) keep_active(kFaultPartSensor);
    else if (part.place_lost) stop_the_line({LineStopCause::place_lost, number});

    const bool position_known = !config_.by_encoder || counted;
    if (accepting() && arrived >= started_at_) {
        part.accepted = true;
        ++accepted_on_line_;
        single_taken_ = true;
    }
    if (!identity_certain || !position_known) return decide(part, PartVerdict::unfit, PartReason::edge_lost);
    if (!part.accepted) return decide(part, PartVerdict::unfit, PartReason::station_not_running);
    if (without_plc(PlcPolicy::reject_all)) return decide(part, PartVerdict::unfit, PartReason::plc_lost);
    if (too_close) return decide(part, PartVerdict::unfit, PartReason::parts_too_close);
    if (line_.size() > config_.max_parts) return decide(part, PartVerdict::unfit, PartReason::line_full);
}

// False without the permit since then: the belt coasts to a stop, stands or is moved by hand, and no time tells where a
// part is.
bool Core::belt_runs_since(TimePoint at) const { return run_permit_ && at >= permitted_since_; }

// Without an encoder: a person has reset the line since, and has taken off it a part that came at this time. Its edge
// was told late; had it been told in time, the reset would have ended its tracking (abandon_lost_places).
bool Core::looked_after_since(TimePoint at) const { return !config_.by_encoder && at < looked_after_at_; }

// True if a part that arrives now is too close to the one ahead. Unless the exposure of that one is over, its frame may
// show both parts: it is rejected, too.
bool Core::comes_too_close(TimePoint at, std::int64_t counts) {
    if (last_arrival_ == TimePoint::min()) return false;
    const bool close_in_time = at - last_arrival_ < config_.min_gap;
    const bool close_in_space =
        config_.by_encoder && last_arrival_counts_ && counts - *last_arrival_counts_ < config_.min_gap_counts;
    if (!close_in_time && !close_in_space) return false;
    if (line_.size() > 0) {
        Part& ahead = line_[line_.size() - 1];
        if (ahead.phase == Part::Phase::waiting && (!ahead.exposed || at < ahead.exposure_start + config_.exposure)) {
            decide(ahead, PartVerdict::unfit, PartReason::parts_too_close);
        }
    }
    return true;
}

// Requests exposure and light trigger_lead before the part is in front of the camera. Returns when that is due;
// TimePoint::max(): done, or not known.
TimePoint Core::expose_when_due(Part& part) {
    const TimePoint start =
        config_.by_encoder ? conveyor_.reaches(part.edge_counts + config_.exposure_counts) : part.exposure_start;
    if (start == TimePoint::max() || now_ < start - config_.trigger_lead) {
        return start == TimePoint::max() ? start : start - config_.trigger_lead;
    }
    part.exposed = true;
    part.exposure_start = start;
    part.asked_at = now_;
    part.place_good = !config_.by_encoder;
    if (now_ > start) {  // too late: the part has passed the camera
        keep_active(kFaultOverrun);
        decide(part, PartVerdict::unfit, PartReason::strobe_failed);
        return TimePoint::max();
    }
    part.frame_due = true;
    part.light_due = true;
    actions_->push(hal::ExposureRequest{part.number(), start, config_.exposure});
    actions_->push(
        hal::StrobePulse{part.number(), config_.strobe_channels, start + config_.strobe_delay, config_.strobe});
    return TimePoint::max();
}

void Core::on(const hal::EncoderReading& reading) {
    conveyor_.read(reading.at, reading.counts);
    if (!config_.by_encoder) return;
    if (reading.at > last_edge_at_) look_for_touching_parts(reading.at, reading.counts);
    for (std::uint32_t k = 0; k < line_.size(); ++k) {
        Part& part = line_[k];
        if (part.exposed && !part.place_good && part.phase == Part::Phase::waiting &&
            reading.at >= part.exposure_start) {
            // The conveyor may have stopped or jumped since the exposure was planned; the frame then shows another
            // part or none.
            const std::int64_t off =
                conveyor_.counts_at(part.exposure_start) - (part.edge_counts + config_.exposure_counts);
            part.place_good = std::max(off, -off) < config_.min_gap_counts / 2;
            if (!part.place_good) decide(part, PartVerdict::unfit, PartReason::edge_lost);
        }
        if (part.passed_ejector == TimePoint::max() && conveyor_.reached(part.target_counts)) {
            part.passed_ejector = conveyor_.reaches(part.target_counts);
        }
    }
}

// The run permit is withdrawn. With an encoder the parts are tracked further. Without one their positions become
// unknown: parts not yet exposed will miss the camera, and no rejection counts as confirmed from now on. Reject
// commands still go out by time until the reset, because the line may keep running.
void Core::lose_permit() {
    if (config_.by_encoder) return;
    covered_ = false;        // on a standing belt the covered time means nothing
    std::uint32_t lost = 0;  // number of the first part whose place is lost
    for (std::uint32_t k = 0; k < line_.size(); ++k) {
        Part& part = line_[k];
        if (now_ < at_ejector(part)) part.place_lost = true;
        if (lost == 0 && part.place_lost && part.phase != Part::Phase::complete) lost = part.number();
        if (part.phase == Part::Phase::waiting && now_ < part.exposure_start + config_.exposure) {
            decide(part, PartVerdict::unfit, PartReason::station_not_running);
        }
    }
    if (lost != 0) stop_the_line({LineStopCause::place_lost, lost});
}

// Reset: a person has looked at the line and removed the parts whose position was lost. Their tracking ends.
void Core::abandon_lost_places() {
    for (std::uint32_t k = 0; k < line_.size(); ++k) {
        Part& part = line_[k];
        if (!part.place_lost) continue;
        part.abandoned = true;
        decide(part, PartVerdict::unfit, PartReason::station_not_running);
    }
}

// The positions of all parts are unknown: parts to be rejected cannot be.
void Core::lose_position() {
    last_arrival_counts_.reset();
    flush(PartReason::device_lost);
    for (std::uint32_t k = 0; k < line_.size(); ++k) line_[k].passed_ejector = TimePoint::min();
    conveyor_.forget();
}

}  // namespace hord::firmware
