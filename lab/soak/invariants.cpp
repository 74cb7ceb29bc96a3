// The true events: parts, faults, light and ejector; checks whether a part may leave or be ejected.
#include "lab/soak/invariants.h"

#include <algorithm>
#include <utility>

namespace hord::lab {

using sim::InjectedFault;

namespace {

constexpr std::array<std::string_view, kPromises> kNames{
    "one-verdict",    "no-bad-part-passes", "own-data",     "own-rejection",     "unconfirmed-stops", "light-limits",
    "counters-agree", "lawful-states",      "true-reasons", "undisturbed-parts", "ready-again",       "bounded",
    "one-story",      "commands-once"};

// A part is still exposed and ejected if the encoder loses at most this while the part is on the line.
constexpr double kToleratedSlip_mm = 4;

// A fault disturbs the line for its amount plus this time, since frames and confirmations may still be awaited.
constexpr Duration kAftermath = milliseconds(1000);

// Faults that may affect neither a verdict nor the line: parts that arrive meanwhile count as undisturbed.
bool harmless(InjectedFault fault) { return fault >= InjectedFault::scada_floods && fault <= InjectedFault::clock_set; }

}  // namespace

std::string_view name_of(Promise promise) { return kNames[static_cast<std::size_t>(promise)]; }

void Invariants::broken(Promise promise, const std::string& what, std::uint64_t part) {
    if (violations_++ == 0) newest_at_violation_ = newest_;
    ++broken_[static_cast<std::size_t>(promise)];
    if (texts_.size() >= 10) return;
    texts_.push_back(std::string(name_of(promise)) + ": " + (part != 0 ? "part " + std::to_string(part) + " " : "") +
                     what);
}

// -- parts

void Invariants::part_arrives(const sim::PartRecord& part) {
    PartHistory& history = parts_[part.number % kMemory];
    if (history.number != 0) check_finished(history);
    history = PartHistory{};
    history.number = part.number;
    history.bad = part.bad;
    history.front_mm = part.front_mm;
    history.arrived_ns = part.arrived.time_since_epoch().count();
    history.station_ran = core_ != nullptr && executing(core_->state());
    history.permitted = core_ != nullptr && core_->run_permit();
    history.touches = part.touches_ahead;
    history.touched = part.touched_behind;
    // A part that touches one without an edge has no edge either: the sensor stays covered.
    history.invisible = part.touches_ahead && newest_ != 0 && parts_[newest_ % kMemory].invisible;
    // Closer to the part ahead than this, a part may be rejected, or its light may not have had its rest time.
    const PartHistory& ahead = parts_[newest_ % kMemory];
    const Duration near =
        std::max(rules_.core.min_gap, cell_.strobe().limits().min_rest + rules_.core.strobe) + milliseconds(2);
    if (newest_ != 0 &&
        part.front_mm - ahead.front_mm <
            1e-9 * static_cast<double>(near.count()) * cell_.world().nominal_speed_mm_s() * 1.05) {
        last_close_ = clock_.now();
        disturbed_until_ = std::max(disturbed_until_, last_close_ + kAftermath);
    }
    newest_ = part.number;
}

// The part must have left the line, and have a verdict if the station saw it.
void Invariants::check_finished(const PartHistory& history) {
    if (!history.gone)
        broken(Promise::bounded, "is still on the line " + std::to_string(kMemory) + " parts later", history.number);
    if (history.delivered && !history.has_result && !history.process_ended)
        broken(Promise::one_verdict, "was seen and got no verdict", history.number);
}

Invariants::PartHistory* Invariants::arrived_at(std::int64_t ns) {
    for (std::uint64_t number = newest_; number > 0 && number + kMemory > newest_; --number) {
        PartHistory& history = parts_[number % kMemory];
        if (history.arrived_ns == ns) return &history;
        if (history.arrived_ns < ns) return nullptr;  // no part arrived then
    }
    return nullptr;
}

Invariants::PartHistory* Invariants::history_of(std::uint32_t station_part) {
    const Line& line = core_->line();
    for (std::uint32_t k = line.size(); k-- > 0;) {
        if (line[k].number() == station_part) return arrived_at(line[k].arrived.time_since_epoch().count());
    }
    return nullptr;
}

void Invariants::part_is_gone(const sim::PartRecord& part) {
    PartHistory& history = parts_[part.number % kMemory];
    if (history.number != part.number) return broken(Promise::bounded, "left before it came", part.number);
    history.gone = true;
    switch (part.fate) {
        case sim::PartRecord::Fate::ejected: check_ejected(history); break;
        case sim::PartRecord::Fate::left: check_exit(history, part.gone); break;
        case sim::PartRecord::Fate::removed: history.taken_by_hand = true; break;
        case sim::PartRecord::Fate::on_line: break;
    }
}

// The main rule: a part that leaves the line was passed.
void Invariants::check_exit(PartHistory& history, TimePoint left) {
    if (history.has_result && history.result.verdict == PartVerdict::pass) return;
    if (history.invisible || history.stuck || history.slipped_mm > kToleratedSlip_mm) {
        ++excused_;
        return;
    }
    // Without a running process nothing stops the line: the next process must, before the belt moves on. It may coast.
    if (core_ == nullptr || clock_.now() <= stalled_until_ + milliseconds(20) + cell_.world().coast()) {
        left_in_outage_ = {left, clock_.now()};
        return;
    }
    broken(Promise::no_bad_part_passes,
           history.has_result ? "left, and was not passed (" + std::string(name_of(history.result.reason)) + ")"
                              : "left without a verdict",
           history.number);
}

void Invariants::check_ejected(PartHistory& history) {
    history.ejected = true;
    if (history.commanded || !history.delivered || history.process_ended) return;
    if (belt_stands()) return;  // the part stopped at the ejector during a pulse: a good part is lost
    if (pulsed_by_fault(clock_.now()) || history.slipped_mm > kToleratedSlip_mm) {
        ++excused_;
        return;
    }
    broken(Promise::own_rejection, "was ejected, and nobody told the ejector to", history.number);
}

bool Invariants::pulsed_by_fault(TimePoint at) const {
    return std::any_of(fault_pulses_.begin(), fault_pulses_.end(), [&](const Interval& p) {
        return at + milliseconds(1) >= p.from && at <= p.until + milliseconds(1);
    });
}

// -- faults

void Invariants::fault(InjectedFault fault, Duration amount) {
    const TimePoint now = clock_.now();
    TimePoint& effect_until = effect_until_[static_cast<std::size_t>(fault)];
    effect_until = std::max(effect_until, now + amount);
    if (harmless(fault)) return;
    faults_until_ = std::max(faults_until_, now + amount + kAftermath);
    disturbed_until_ = std::max(disturbed_until_, faults_until_);
    not_ready_reported_ = false;
    const auto mm_in = [&](Duration motion) {
        return 1e-9 * static_cast<double>(motion.count()) * cell_.world().nominal_speed_mm_s();
    };
    switch (fault) {
        case InjectedFault::process_stalled: stalled_until_ = std::max(stalled_until_, now + amount); break;
        case InjectedFault::edge_missed: parts_[newest_ % kMemory].invisible = true; break;
        case InjectedFault::encoder_slip:
            for (PartHistory& history : parts_) {
                if (history.number != newest_ && !history.gone) history.slipped_mm += mm_in(amount);
            }
            slipped_at_ = now;
            slipped_mm_ = mm_in(amount);
            if (now < encoder_silent_until_) parts_[newest_ % kMemory].slipped_mm += slipped_mm_;
            break;
        case InjectedFault::encoder_silent:
            // The newest part's edge then has no encoder count: its position is extrapolated from before the slip.
            if (slipped_at_ == now && now >= encoder_silent_until_) parts_[newest_ % kMemory].slipped_mm += slipped_mm_;
            encoder_silent_until_ = std::max(encoder_silent_until_, now + amount);
            break;
        case InjectedFault::ejector_stuck:
            if (PartHistory* history = history_of(last_reject_.part)) history->stuck = true;
            break;
        case InjectedFault::reject_late: {
            const TimePoint from = std::max(last_reject_.start, now) + amount;
            fault_pulses_[next_fault_pulse_++ % fault_pulses_.size()] = {from, from + last_reject_.width};
            break;
        }
        case InjectedFault::reject_twice: {
            const TimePoint from = last_reject_.start + last_reject_.width + amount;
            fault_pulses_[next_fault_pulse_++ % fault_pulses_.size()] = {from, from + last_reject_.width};
            break;
        }
        default: break;
    }
}

bool Invariants::any_in_effect(std::uint64_t faults, TimePoint since) const {
    for (std::size_t k = 0; k < sim::kInjectedFaults; ++k) {
        if ((faults >> k & 1U) != 0 && effect_until_[k] != TimePoint{} && effect_until_[k] >= since) return true;
    }
    return false;
}

// The belt is looked at in each step: the time in which it stands is at most a step too short or too long.
void Invariants::watch_belt() {
    const bool stands = belt_stands();
    if (stands && !stood_)
        stands_[next_stand_++ % stands_.size()] = {clock_.now(), clock_.now(), cell_.world().belt_mm(clock_.now())};
    if (stands || stood_) stands_[(next_stand_ - 1) % stands_.size()].until = clock_.now();
    stood_ = stands;
}

Duration Invariants::belt_stood(TimePoint from, TimePoint until) const {
    Duration sum{};
    for (const Stand& stand : stands_)
        sum += std::max(Duration::zero(), std::min(stand.until, until) - std::max(stand.from, from));
    return sum;
}

// The belt stood with the part just before the camera. When it moves again, the station knows its speed only after two
// readings of the encoder; a part that is at the camera by then, or too soon for the trigger's lead, cannot be exposed.
bool Invariants::stood_before_camera(const PartHistory& history) const {
    constexpr Duration kTwoReadings = milliseconds(10);
    const double near_mm = 1e-9 * static_cast<double>((kTwoReadings + rules_.core.trigger_lead).count()) *
        cell_.world().nominal_speed_mm_s();
    return std::any_of(stands_.begin(), stands_.end(), [&](const Stand& stand) {
        const double before_mm = history.front_mm + cell_.world().geometry().camera_mm - stand.belt_mm;
        return stand.until.time_since_epoch().count() > history.arrived_ns && before_mm > 0 && before_mm <= near_mm;
    });
}

TimePoint Invariants::edge_ahead(TimePoint arrived) const {
    TimePoint newest{};
    for (const TimePoint edge : edges_) {
        if (edge < arrived) newest = std::max(newest, edge);
    }
    return newest;
}

// -- processes

void Invariants::process_starts(const Core& core, const CoreConfig& config) {
    core_ = &core;
    rules_.core = config;
    reported_ = checked_counters_ = {};
    checked_results_ = missed_ = last_edge_ = 0;
    front_at_ = TimePoint::min();
    reported_inspected_ = results_in_process_ = 0;
    pulse_until_ = pulse_until_before_ = permit_lost_at_ = {};
    had_permit_ = false;
    first_fault_ = 0;
    evidence_.fill({});
}

void Invariants::process_ends() {
    core_ = nullptr;
    part_sensor_up_ = had_line_stop_ = false;
    for (PartHistory& history : parts_) history.process_ended = history.process_ended || !history.has_result;
}

// -- calls between station and devices

void Invariants::edge_delivered(const hal::PartEdge& edge) {
    if (edge.kind == hal::PartEdge::Kind::arrives) edges_[next_edge_++ % edges_.size()] = edge.at;
    if (PartHistory* history = arrived_at(edge.at.time_since_epoch().count())) history->delivered = true;
}

Invariants::Evidence& Invariants::evidence_of(std::uint32_t station_part) {
    Evidence& evidence = evidence_[station_part % kMemory];
    if (evidence.part != station_part) evidence = {};
    evidence.part = station_part;
    return evidence;
}

void Invariants::lit(const hal::StrobePulse& pulse) {
    const hal::StrobeLimits limits = cell_.strobe().limits();
    if (pulse.width > limits.max_on) broken(Promise::light_limits, "a light is on longer than its limit");
    if (ever_lit_ && pulse.start < light_until_ + limits.min_rest)
        broken(Promise::light_limits, "a light did not rest");
    const PartHistory* const history = history_of(pulse.exposure);
    if (history != nullptr && !history->station_ran)
        broken(Promise::lawful_states, "is inspected, and came while the station did not run", history->number);
    light_until_ = pulse.start + pulse.width;
    ever_lit_ = true;
    evidence_of(pulse.exposure).pulse = pulse;
}

void Invariants::strobe_reported(const hal::StrobeReport& report) {
    Evidence& evidence = evidence_of(report.exposure);
    const Duration off =
        report.start > evidence.pulse.start ? report.start - evidence.pulse.start : evidence.pulse.start - report.start;
    const Duration wide =
        report.width > evidence.pulse.width ? report.width - evidence.pulse.width : evidence.pulse.width - report.width;
    evidence.light_correct = report.lit && off <= rules_.core.strobe_window && wide <= rules_.core.strobe_window;
}

void Invariants::submitted(std::uint32_t station_part, const hal::FrameInfo& frame, const FrameTruth& truth) {
    Evidence& evidence = evidence_of(station_part);
    if (evidence.submitted)
        broken(Promise::own_data, "two frames were inspected for station part " + std::to_string(station_part));
    evidence.submitted = true;
    if (truth.trigger != station_part) {
        broken(Promise::own_data,
               "the frame of the trigger for station part " + std::to_string(truth.trigger) +
                   " was inspected for station part " + std::to_string(station_part));
    }
    evidence.true_part = truth.part;
    const TimePoint asked = evidence.pulse.start - rules_.core.strobe_delay;
    const Duration off = frame.exposure_start > asked ? frame.exposure_start - asked : asked - frame.exposure_start;
    evidence.frame_correct =
        !frame.corrupt && frame.bytes_used >= core_->config().frame_bytes && off <= rules_.core.frame_window;
}

void Invariants::judged(const Judged& judged) {
    evidence_of(judged.part).judged_good = !judged.failed && judged.verdict == algo::Verdict::pass;
}

void Invariants::rejecting(const hal::RejectCommand& command) {
    last_reject_ = command;
    PartHistory* history = history_of(command.part);
    if (history == nullptr) return;
    if (history->commanded) broken(Promise::own_rejection, "is commanded to be rejected twice", history->number);
    if (history->has_result && history->result.verdict == PartVerdict::pass)
        broken(Promise::own_rejection, "was passed, and is rejected", history->number);
}

void Invariants::reject_reported(const hal::RejectReport& report) {
    Evidence& evidence = evidence_of(report.part);
    if (!std::exchange(evidence.reject_told, true)) evidence.report = report;
}

void Invariants::rejecting_done(bool accepted) {
    if (accepted) pulse_until_ = std::max(pulse_until_, last_reject_.start + last_reject_.width);
    PartHistory* history = history_of(last_reject_.part);
    if (history != nullptr && accepted) history->commanded = true;
}

}  // namespace hord::lab
