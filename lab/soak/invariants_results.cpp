// What the station reports: its steps, its results and its counters.
#include <algorithm>
#include <utility>

#include "lab/soak/invariants.h"

namespace hord::lab {

using sim::InjectedFault;

namespace {

template <class... Faults>
constexpr std::uint64_t any_of(Faults... faults) {
    return ((std::uint64_t{1} << static_cast<unsigned>(faults)) | ...);
}
static_assert(sim::kInjectedFaults <= 64);

// The faults that can cause a reason. A reason that is not listed may follow from any stop or any neighbour.
struct PossibleCauses {
    PartReason reason;
    std::uint64_t faults;
};
constexpr std::array kPossibleCauses{
    PossibleCauses{PartReason::verdict_late,
                   any_of(InjectedFault::inspector_slow, InjectedFault::process_stalled, InjectedFault::frame_late,
                          InjectedFault::encoder_silent, InjectedFault::encoder_slip, InjectedFault::belt_stop,
                          InjectedFault::part_sensor_lost, InjectedFault::rejector_down,
                          InjectedFault::device_unplugged, InjectedFault::inspector_hangs)},
    PossibleCauses{PartReason::frame_lost,
                   any_of(InjectedFault::frame_drop, InjectedFault::frame_stale, InjectedFault::frame_late,
                          InjectedFault::sensor_lost, InjectedFault::inspector_slow, InjectedFault::process_stalled,
                          InjectedFault::process_crash, InjectedFault::device_unplugged, InjectedFault::inspector_hangs,
                          InjectedFault::trigger_late)},
    PossibleCauses{PartReason::frame_stale,
                   any_of(InjectedFault::frame_stale, InjectedFault::frame_late, InjectedFault::process_stalled,
                          InjectedFault::sensor_lost, InjectedFault::device_unplugged, InjectedFault::trigger_late)},
    PossibleCauses{PartReason::frame_duplicate,
                   any_of(InjectedFault::frame_duplicate, InjectedFault::frame_late, InjectedFault::frame_stale,
                          InjectedFault::trigger_late)},
    PossibleCauses{PartReason::frame_short, any_of(InjectedFault::frame_short)},
    PossibleCauses{PartReason::frame_corrupt, any_of(InjectedFault::frame_corrupt)},
    PossibleCauses{PartReason::strobe_failed,
                   any_of(InjectedFault::strobe_refused, InjectedFault::strobe_late, InjectedFault::strobe_lost,
                          InjectedFault::strobe_short, InjectedFault::process_stalled, InjectedFault::edge_bounce,
                          InjectedFault::edge_ghost, InjectedFault::part_close, InjectedFault::encoder_slip,
                          InjectedFault::encoder_silent, InjectedFault::belt_stop, InjectedFault::part_sensor_lost,
                          InjectedFault::sensor_lost, InjectedFault::device_unplugged)},
    PossibleCauses{
        PartReason::inspector_failed,
        any_of(InjectedFault::inspector_failed, InjectedFault::inspector_slow, InjectedFault::inspector_hangs)},
    PossibleCauses{PartReason::edge_lost,
                   any_of(InjectedFault::edge_lost, InjectedFault::edge_missed, InjectedFault::edge_bounce,
                          InjectedFault::edge_ghost, InjectedFault::process_stalled, InjectedFault::encoder_silent,
                          InjectedFault::encoder_slip, InjectedFault::belt_stop, InjectedFault::part_touching)},
    PossibleCauses{PartReason::parts_too_close,
                   any_of(InjectedFault::edge_bounce, InjectedFault::edge_ghost, InjectedFault::part_close,
                          InjectedFault::part_touching, InjectedFault::encoder_slip, InjectedFault::belt_stop,
                          InjectedFault::process_stalled, InjectedFault::edge_missed, InjectedFault::part_sensor_lost,
                          InjectedFault::encoder_silent, InjectedFault::restart_ordered, InjectedFault::process_crash,
                          InjectedFault::plc_commands, InjectedFault::device_unplugged, InjectedFault::plc_walks)},
    PossibleCauses{PartReason::plc_lost,
                   any_of(InjectedFault::plc_silent, InjectedFault::process_stalled, InjectedFault::process_crash,
                          InjectedFault::restart_ordered, InjectedFault::plc_walks)},
    PossibleCauses{PartReason::too_dark,
                   any_of(InjectedFault::frame_dark, InjectedFault::strobe_dead, InjectedFault::strobe_weak,
                          InjectedFault::strobe_late, InjectedFault::frame_stale, InjectedFault::strobe_lost,
                          InjectedFault::strobe_short, InjectedFault::device_unplugged, InjectedFault::trigger_late)},
    PossibleCauses{PartReason::saturated, any_of(InjectedFault::frame_saturated, InjectedFault::frame_stale)},
};
// Faults that make edges which are not those of a part: the station cannot count hidden parts exactly.
constexpr std::uint64_t kUnclearEdges =
    any_of(InjectedFault::edge_ghost, InjectedFault::edge_bounce, InjectedFault::edge_missed);
// Faults that make one part look like two that touch: a ghost edge covers the sensor, a bounce does if the part's other
// edges are missed, the belt stands with its permit, the encoder is silent as the part comes, or the process reads the
// time or the encoder after a stall before the edges that wait for it.
constexpr std::uint64_t kSeemToTouch =
    any_of(InjectedFault::edge_ghost, InjectedFault::edge_missed, InjectedFault::belt_stop,
           InjectedFault::encoder_silent, InjectedFault::process_stalled);
// Longest time from the end of a fault's effect to the verdict that it causes: a part is on the line for 0.8 s, and a
// PLC's silence ends with its next cycle. The time for which the belt stood with the part on it comes on top.
constexpr Duration kCauseLag = milliseconds(1000);

}  // namespace

// What an event must have done when its step is over.
void Invariants::check_event(State before, const Event& event) {
    const State now = core_->state();
    const auto* command = std::get_if<Command>(&event);
    const bool gives_up =
        command != nullptr && (*command == Command::abort || *command == Command::halt) && now != before;
    const bool rejects_all =
        std::holds_alternative<PlcLost>(event) && core_->config().plc_policy == PlcPolicy::reject_all;
    const Line& line = core_->line();
    for (std::uint32_t k = 0; (gives_up || rejects_all) && k < line.size(); ++k) {
        if (line[k].phase == Part::Phase::waiting)
            broken(Promise::one_verdict, "still waits for its verdict after an abort, halt or lost PLC",
                   line[k].number());
    }
    const bool armed = before == State::initialized && now == State::ready;
    if (armed && clock_.now() < pulse_until_before_)
        broken(Promise::own_rejection, "the station was armed while the ejector still had a pulse to execute");
    if (command != nullptr && *command == Command::reset) first_fault_ = 0;
    const bool was_running = executing(before) || before == State::ready;
    if (was_running && now == State::error && !core_->line_stop() && core_->all_devices_up()) check_failures_in_a_row();
}

// Without line stop and without a lost device, only failures in a row lead to Error. A judged part ends the row.
void Invariants::check_failures_in_a_row() {
    std::vector<std::pair<std::int64_t, bool>> decided;  // when, and whether a device failed: sorted last
    const auto add = [&](const PartResult& r) {
        const bool dark = r.reason == PartReason::too_dark || r.reason == PartReason::saturated;
        decided.emplace_back(r.arrived_ns / 1000 + r.latency_us, !is_judged(r.reason) || dark);
    };
    for (const PartHistory& history : parts_) {
        if (history.has_result) add(history.result);
    }
    const Line& line = core_->line();
    for (std::uint32_t k = 0; k < line.size(); ++k) {
        if (line[k].phase == Part::Phase::decided || line[k].phase == Part::Phase::commanded) add(line[k].result);
    }
    std::sort(decided.begin(), decided.end());
    const std::size_t row = core_->config().max_failures_in_a_row;
    const auto in_row = decided.end() - static_cast<std::ptrdiff_t>(std::min(row, decided.size()));
    const bool judged = std::any_of(in_row, decided.end(), [](const auto& part) { return !part.second; });
    if (decided.size() < row || judged)
        broken(Promise::lawful_states, "the station went to Error, and its last parts were judged");
}

void Invariants::faults_shown(std::uint16_t first_fault, std::uint32_t latched) {
    if (first_fault_ != 0 && first_fault != first_fault_)
        broken(Promise::one_story, "the first fault is another one without a reset");
    if (first_fault != 0 && (latched >> (first_fault - 1U) & 1U) == 0)
        broken(Promise::one_story, "the first fault is not among the latched ones");
    first_fault_ = first_fault;
}

void Invariants::stepped(State before, const Event& event) {
    struct {
        State state;
        bool line_stop, run_permit;
        std::uint32_t parts_on_line;
    } const now{core_->state(), core_->line_stop(), core_->run_permit(), core_->line().size()};
    const auto lawful = [&] {
        if (now.state == before) return true;
        for (const Transition& first : kTransitions) {
            if (first.from != before) continue;
            if (first.to == now.state) return true;
            for (const Transition& second : kTransitions) {  // two in one step
                if (second.from == first.to && second.to == now.state) return true;
            }
        }
        return false;
    };
    if (!lawful())
        broken(Promise::lawful_states,
               "the state changed from " + std::string(name_of(before)) + " to " + std::string(name_of(now.state)));
    if (now.run_permit && (now.line_stop || !(executing(now.state) || now.state == State::ready))) {
        broken(Promise::lawful_states,
               "the line may run in " + std::string(name_of(now.state)) + (now.line_stop ? " with line stop" : ""));
    }
    if (now.run_permit && now.state == State::ready && now.parts_on_line == 0)
        broken(Promise::lawful_states, "the line may run in Ready, and it is empty");
    if (had_permit_ && !now.run_permit) permit_lost_at_ = clock_.now();
    had_permit_ = now.run_permit;
    PartHistory& newest = parts_[newest_ % kMemory];  // it may have come at the very moment of the start
    if (newest.arrived_ns == clock_.now().time_since_epoch().count()) {
        newest.station_ran = newest.station_ran || executing(now.state);
        newest.permitted = newest.permitted || now.run_permit;
    }
    check_event(before, event);
    pulse_until_before_ = pulse_until_;
    if (cell_.rejector().run_permit() && now.line_stop)
        broken(Promise::unconfirmed_stops, "line stop, and the belt has its permit");
    if (now.parts_on_line > rules_.most_on_line)
        broken(Promise::bounded, std::to_string(now.parts_on_line) + " parts are on the line");

    const TimePoint time = clock_.now();
    steps_at_once_ = time == stepped_at_ ? steps_at_once_ + 1 : 0;
    stepped_at_ = time;
    if (steps_at_once_ == kMaxStepsAtOnce)
        broken(Promise::bounded, "the station steps and steps, and time stands still");
    watch_belt();
    watch_line_stop();
    if (now.state != State::continuous_execution || now.line_stop) {
        disturbed_until_ = std::max(disturbed_until_, time + milliseconds(1000));
        if (time > faults_until_ + kReadyWithin && !not_ready_reported_) {
            not_ready_reported_ = true;
            broken(Promise::ready_again, "the station is still in " + std::string(name_of(now.state)));
        }
    }
    check_missed(before, event);
    check_counters();
}

// A part that left while no process could stop the line must be answered by a line stop behind it that stays long
// enough to be seen. The part's own time counts, not the time at which the observer was told: in two stalls one after
// the other, the station stops the line between them, and the observer is told after both.
void Invariants::watch_line_stop() {
    const TimePoint time = clock_.now();
    const bool stopped = core_->line_stop();
    if (stopped) last_line_stop_ = time;
    if (stopped && !had_line_stop_) line_stop_.from = time;
    if (stopped || had_line_stop_) line_stop_.until = time;
    had_line_stop_ = stopped;
    if (!left_in_outage_) return;
    if (line_stop_.until >= std::max(line_stop_.from, left_in_outage_->from) + kMinLineStop) {
        left_in_outage_.reset();
    } else if (!stopped && core_->run_permit() && time > left_in_outage_->until + milliseconds(500)) {
        broken(Promise::no_bad_part_passes,
               "a part left while the process did not run, and the line was never stopped for it");
        left_in_outage_.reset();
    }
}

void Invariants::result(const PartResult& r) {
    ++results_;
    ++reasons_[static_cast<std::size_t>(r.reason) % reasons_.size()];
    for (const std::uint64_t value :
         {std::uint64_t{r.part}, static_cast<std::uint64_t>(r.arrived_ns),
          std::uint64_t{static_cast<unsigned>(r.verdict)}, std::uint64_t{static_cast<unsigned>(r.reason)},
          std::uint64_t{static_cast<unsigned>(r.reject)}, std::uint64_t{r.latency_us}}) {
        fingerprint_.add_word(value);
    }
    if (r.sequence != ++results_in_process_)
        broken(Promise::one_verdict, "results are not numbered one by one", r.part);
    if ((r.verdict == PartVerdict::pass) != (r.reject == RejectState::not_needed))
        broken(Promise::one_verdict, "verdict and rejection disagree", r.part);

    switch (r.verdict) {
        case PartVerdict::pass: ++reported_.pass; break;
        case PartVerdict::reject: ++reported_.reject; break;
        case PartVerdict::unfit: ++reported_.unfit; break;
    }
    switch (r.reject) {
        case RejectState::confirmed: ++reported_.reject_confirmed; break;
        case RejectState::failed: ++reported_.reject_failed; break;
        case RejectState::late: ++reported_.reject_late; break;
        case RejectState::not_needed:
        case RejectState::commanded: break;
    }
    reported_inspected_ += is_judged(r.reason) ? 1U : 0U;
    const bool unconfirmed = r.reject == RejectState::failed || r.reject == RejectState::late;
    if (core_->line_stop()) last_line_stop_ = clock_.now();
    if (unconfirmed && (last_line_stop_ - TimePoint{}).count() < r.arrived_ns) {
        broken(Promise::unconfirmed_stops, "was not surely ejected, and the line runs", r.part);
    }
    check_reason(r);
    check_rejection(r);

    PartHistory* history = arrived_at(r.arrived_ns);
    if (r.verdict == PartVerdict::pass) check_passed(r, history);
    if (history == nullptr) return;  // an edge without a part
    if (history->has_result) broken(Promise::one_verdict, "has two verdicts", history->number);
    history->has_result = true;
    history->result = r;
    check_undisturbed(r, *history);
}

void Invariants::check_passed(const PartResult& r, PartHistory* history) {
    const Evidence& evidence = evidence_of(r.part);
    if (history == nullptr)
        return broken(Promise::own_data,
                      "station part " + std::to_string(r.part) + " was passed, and there is no such part");
    // The station still exposes a part that a person has removed, and the real inspection passes a clear empty field.
    // Then no part was passed.
    const bool nothing_there = !rules_.perfect_detection && evidence.true_part == 0 && history->taken_by_hand;
    if (!evidence.submitted || (evidence.true_part != history->number && !nothing_there)) {
        broken(Promise::own_data, "was passed by the frame of part " + std::to_string(evidence.true_part),
               history->number);
    }
    if (!evidence.frame_correct)
        broken(Promise::own_data, "was passed by a frame that is stale, short or corrupt", history->number);
    if (!evidence.light_correct) broken(Promise::own_data, "was passed, and its light was not right", history->number);
    if (!evidence.judged_good) broken(Promise::own_data, "was passed, and not judged good", history->number);
    const CoreConfig& core = rules_.core;
    const std::int64_t now_ns = (clock_.now() - TimePoint{}).count();
    if (!core.by_encoder &&
        now_ns > history->arrived_ns + (core.transport - core.reject_early - core.reject_lead).count()) {
        broken(Promise::own_data, "was passed after its verdict was due", history->number);
    }
    const double left_mm =
        history->front_mm + cell_.world().geometry().ejector_mm - cell_.world().belt_mm(clock_.now());
    const double lead_mm =
        cell_.world().nominal_speed_mm_s() * 1e-9 * static_cast<double>((core.reject_early + core.reject_lead).count());
    if (core.by_encoder && left_mm + history->slipped_mm < 0.9 * lead_mm - 1 && !belt_stands()) {
        broken(Promise::own_data, "was passed after its verdict was due", history->number);
    }
    if (history->gone && !history->taken_by_hand)
        broken(Promise::own_data, "was passed when it was gone already", history->number);
    if (!history->bad) return;
    ++passed_bad_;
    if (rules_.perfect_detection) broken(Promise::no_bad_part_passes, "is bad, and was passed", history->number);
}

// The first report of a rejection counts. On a line without an encoder no rejection is sure if the run permit was
// away when the part came, or was withdrawn while it was on its way.
void Invariants::check_rejection(const PartResult& r) {
    const std::int64_t age_us = (clock_.now().time_since_epoch().count() - r.arrived_ns) / 1000;
    if (r.verdict == PartVerdict::pass ? r.latency_us != age_us : r.latency_us > age_us)
        broken(Promise::one_story, "has a latency that no clock showed", r.part);
    if (r.reject != RejectState::confirmed) {
        if (r.reject_latency_us != 0)
            broken(Promise::one_story, "has a latency of a rejection, and no rejection", r.part);
        return;
    }
    const Evidence& evidence = evidence_of(r.part);
    if (!evidence.reject_told || evidence.report.outcome != hal::RejectReport::Outcome::confirmed)
        return broken(Promise::unconfirmed_stops, "is called ejected, and the rejector did not say so", r.part);
    if (std::max<std::int64_t>(1, (evidence.report.at.time_since_epoch().count() - r.arrived_ns) / 1000) !=
        r.reject_latency_us)
        broken(Promise::one_story, "has a latency of its rejection that no clock showed", r.part);
    const TimePoint arrived(Duration(r.arrived_ns)), at_ejector = arrived + rules_.core.transport;
    if (!rules_.core.by_encoder && permit_lost_at_ > arrived && permit_lost_at_ < at_ejector)
        broken(Promise::unconfirmed_stops, "is called ejected, and the belt may have stood on its way", r.part);
    const PartHistory* const history = arrived_at(r.arrived_ns);
    if (!rules_.core.by_encoder && history != nullptr && !history->permitted)
        broken(Promise::unconfirmed_stops, "is called ejected, and came while the belt had no permit", r.part);
}

void Invariants::check_reason(const PartResult& r) {
    const TimePoint arrived(Duration(r.arrived_ns));
    const TimePoint decided = arrived + microseconds(r.latency_us) + microseconds(1);
    // With an encoder, a part on a belt that stands waits there for its exposure, and for what happened before.
    // What is too close was caused at the edge ahead, or between the two.
    const TimePoint from = r.reason == PartReason::parts_too_close ? edge_ahead(arrived) : arrived;
    const Duration waited = rules_.core.by_encoder ? belt_stood(from, decided) : Duration::zero();
    const TimePoint since = decided - kCauseLag - waited;
    const bool close = last_close_ != TimePoint::min() && last_close_ >= since;
    if (close && (r.reason == PartReason::parts_too_close || r.reason == PartReason::strobe_failed)) return;
    const PartHistory* const history = arrived_at(r.arrived_ns);
    if (rules_.core.by_encoder && r.reason == PartReason::strobe_failed && history != nullptr &&
        stood_before_camera(*history))
        return;
    for (const PossibleCauses& cause : kPossibleCauses) {
        if (cause.reason == r.reason && rules_.perfect_detection && !any_in_effect(cause.faults, since)) {
            broken(Promise::true_reasons,
                   "is unfit (" + std::string(name_of(r.reason)) + "), and nothing of the kind happened", r.part);
        }
    }
}

// Applies to a part if nothing was wrong from a second before its arrival until now.
void Invariants::check_undisturbed(const PartResult& r, const PartHistory& history) {
    if (!rules_.perfect_detection || TimePoint(Duration(history.arrived_ns)) <= disturbed_until_) return;
    ++undisturbed_;
    if (!history.bad && r.verdict != PartVerdict::pass) {
        broken(Promise::undisturbed_parts,
               "is good, nothing was wrong, and it was not passed (" + std::string(name_of(r.reason)) + ")",
               history.number);
    }
    // check_exit() sees whether it was really ejected.
    if (history.bad && (r.verdict != PartVerdict::reject || r.reject != RejectState::confirmed)) {
        broken(Promise::undisturbed_parts, "is bad, nothing was wrong, and it was not rejected for sure",
               history.number);
    }
}

// Compares only after a counter or the number of results has changed.
void Invariants::check_counters() {
    const Counters& c = core_->counters();
    if (results_in_process_ == checked_results_ && c == checked_counters_) return;
    checked_results_ = results_in_process_;
    checked_counters_ = c;
    Counters pending;  // parts that are decided but not reported yet
    std::uint32_t waiting = 0, inspected = 0;
    const Line& line = core_->line();
    for (std::uint32_t k = 0; k < line.size(); ++k) {
        const Part& p = line[k];
        if (p.phase == Part::Phase::waiting) ++waiting;
        if (p.phase != Part::Phase::decided && p.phase != Part::Phase::commanded) continue;
        (p.result.verdict == PartVerdict::reject ? pending.reject : pending.unfit) += 1;
        pending.reject_commanded += p.phase == Part::Phase::commanded ? 1U : 0U;
        inspected += is_judged(p.result.reason) ? 1U : 0U;
    }
    const bool agree = c.pass == reported_.pass && c.reject == reported_.reject + pending.reject &&
        c.unfit == reported_.unfit + pending.unfit && c.reject_confirmed == reported_.reject_confirmed &&
        c.reject_failed == reported_.reject_failed && c.reject_late == reported_.reject_late &&
        c.reject_commanded == reported_.reject + reported_.unfit + pending.reject_commanded &&
        c.inspected == reported_inspected_ + inspected && c.seen == c.pass + c.reject + c.unfit + waiting;
    if (!agree) broken(Promise::counters_agree, "the counters are not what was reported");
}

// True if the sensor was covered by two parts that touch, and the station could know it.
bool Invariants::hides_a_part(const hal::PartEdge& leaves) {
    const PartHistory &behind = parts_[newest_ % kMemory], &ahead = parts_[(newest_ - 1) % kMemory];
    if (!behind.touches || ahead.arrived_ns != front_at_.time_since_epoch().count()) return false;
    const CoreConfig& core = rules_.core;
    if (!core.by_encoder && (!ahead.permitted || !had_permit_ || permit_lost_at_ > front_at_)) return false;
    const sim::World& world = cell_.world();
    const double longest_mm = core.by_encoder
        ? static_cast<double>(core.max_part_counts) * world.geometry().camera_mm /
            static_cast<double>(core.exposure_counts)
        : 1e-9 * static_cast<double>(core.max_part.count()) * world.nominal_speed_mm_s();
    return cell_.world().belt_mm(leaves.at) - ahead.front_mm > longest_mm + 1 &&
        !any_in_effect(kUnclearEdges | any_of(InjectedFault::edge_lost), front_at_ - kCauseLag);
}

// A part counts as missed if its edge was lost, if it covered the sensor as that came up, or if it touches another one;
// and for no other reason.
void Invariants::check_missed(State before, const Event& event) {
    const std::uint32_t grown = core_->counters().missed - std::exchange(missed_, core_->counters().missed);
    if (const auto* up = std::get_if<DeviceUp>(&event); up != nullptr && up->device == Device::part_sensor)
        last_edge_ = 0;
    std::uint32_t lost = 0;
    const auto* edge = std::get_if<hal::PartEdge>(&event);
    if (edge != nullptr) {
        const bool arrives = edge->kind == hal::PartEdge::Kind::arrives;
        lost = edge->sequence > last_edge_ ? edge->sequence - last_edge_ - 1 : 0;
        if (lost > 0 && grown == 0 && !any_in_effect(kUnclearEdges, clock_.now() - kCauseLag))
            broken(Promise::counters_agree, "an arrival was lost, and no part counts as missed");
        const bool was_there = !arrives && last_edge_ == 0 && lost == 0;
        if (was_there && grown == 0 && before != State::halted && before != State::preoperational)
            broken(Promise::counters_agree, "a part covered the sensor as it came up, and does not count as missed");
        lost += was_there ? 1U : 0U;
        if (!arrives && hides_a_part(*edge) && missed_ == missed_at_front_)
            broken(Promise::counters_agree, "a part touches the one ahead, and does not count as missed", newest_);
        last_edge_ = edge->sequence;
        if (arrives) {
            missed_at_front_ = missed_;
            front_at_ = edge->at;
        }
    }
    const PartHistory &newest = parts_[newest_ % kMemory], &ahead = parts_[(newest_ - 1) % kMemory];
    const bool touches = newest.touches || newest.touched || ahead.touches || ahead.touched;
    // What covered the sensor is the cause, however long the belt stood since.
    const TimePoint since = (front_at_ == TimePoint::min() ? clock_.now() : front_at_) - kCauseLag;
    if (grown > lost + 1 || (grown == lost + 1 && !touches && !any_in_effect(kSeemToTouch, since))) {
        broken(Promise::counters_agree, "a part counts as missed, and nothing of the kind happened");
    }
}

void Invariants::end() {
    for (const PartHistory& history : parts_) {
        if (history.number != 0) check_finished(history);
    }
    if (cell_.strobe().longest_on() > cell_.strobe().limits().max_on)
        broken(Promise::light_limits, "a light was on longer than its limit");
}

}  // namespace hord::lab
