#include "firmware/soak/invariants.h"

#include <algorithm>

namespace hord::firmware {

using sim::Fault;

void Invariants::violation(const std::string& what, std::uint64_t number) {
    if (violations_++ == 0) newest_at_violation_ = newest_;
    if (texts_.size() < 10) texts_.push_back("part " + std::to_string(number) + ": " + what);
}

// A fault invisible to any station excuses at most one part of a kind each time it fires.
void Invariants::excuse(Excuse kind, std::initializer_list<Fault> faults, const std::string& what, std::uint64_t number) {
    std::uint64_t fired = 0;
    for (const Fault fault : faults) fired += faults_.fired(fault);
    if (++excused_[static_cast<std::size_t>(kind)] > fired) violation(what, number);
}

void Invariants::part_arrives(const sim::PartRecord& part) {
    Known& known = parts_[part.number % kMemory];
    if (known.number != 0 && !(known.gone && known.has_result)) {
        if (!known.gone) violation("is still on the line 1024 parts later", known.number);
    }
    known = Known{};
    known.number = part.number;
    known.bad = part.bad;
    known.arrived_ns = part.arrived.time_since_epoch().count();
    newest_ = part.number;
}

void Invariants::part_is_gone(const sim::PartRecord& part, bool line_may_run) {
    Known& known = parts_[part.number % kMemory];
    if (known.number != part.number) return violation("left before it came", part.number);
    known.gone = true;
    known.ejected = part.fate == sim::PartRecord::Fate::ejected;
    known.stood_still = !line_may_run;
    if (known.has_result) return settle(known);
    // No verdict yet. Its rejection may still be in doubt; but a part nobody knows of must have stopped the line.
    const bool stopped = last_stop_.time_since_epoch().count() >= known.arrived_ns;
    const bool awaited = !stopped && known.ejected;  // commanded, the report is on its way
    if (!stopped && !awaited) {
        excuse(Excuse::unseen, {Fault::edge_missed, Fault::ejector_stuck, Fault::reject_lost, Fault::reject_late, Fault::reject_unacknowledged,
                Fault::rejector_down, Fault::encoder_slip}, "left without a verdict, and the line ran on", part.number);
    }
}

void Invariants::frame_inspected(std::uint32_t station_part, std::uint64_t judged_by) {
    judgements_[station_part % kMemory] = {station_part, judged_by};
}

Invariants::Known* Invariants::arrived_at(std::int64_t ns) {
    for (std::uint64_t number = newest_; number > 0 && number + kMemory > newest_; --number) {
        Known& known = parts_[number % kMemory];
        if (known.arrived_ns == ns) return &known;
        if (known.arrived_ns < ns) return nullptr;  // nothing came then: a ghost
    }
    return nullptr;
}

void Invariants::result(const PartResult& r, const Core& core, hal::TimePoint now) {
    ++results_;
    ++reasons_[static_cast<std::size_t>(r.reason) % reasons_.size()];
    for (const std::uint64_t value : {std::uint64_t{r.part}, static_cast<std::uint64_t>(r.arrived_ns), std::uint64_t{static_cast<unsigned>(r.verdict)},
                                      std::uint64_t{static_cast<unsigned>(r.reason)}, std::uint64_t{static_cast<unsigned>(r.reject)},
                                      std::uint64_t{r.latency_us}}) {
        fingerprint_ = (fingerprint_ ^ value) * 0x100000001B3U;
    }
    if (r.sequence != results_) violation("results are not numbered one by one", r.part);
    const bool unconfirmed = r.reject == RejectState::failed || r.reject == RejectState::late;
    if (core.snapshot().line_stop) last_stop_ = now;
    if (unconfirmed && last_stop_.time_since_epoch().count() < r.arrived_ns) violation("its rejection is unconfirmed and the line runs", r.part);
    if ((r.verdict == PartVerdict::pass) != (r.reject == RejectState::not_needed)) violation("verdict and rejection disagree", r.part);

    const Counters& c = core.snapshot().counters;
    std::uint32_t waiting = 0, decided = 0, commanded = 0;
    for (std::uint32_t k = 0; k < core.line().size(); ++k) {
        const Part::Phase phase = core.line()[k].phase;
        waiting += phase == Part::Phase::waiting ? 1U : 0U;
        decided += phase == Part::Phase::decided ? 1U : 0U;
        commanded += phase == Part::Phase::commanded ? 1U : 0U;
    }
    if (c.seen != c.pass + c.reject + c.unfit + waiting || c.reject + c.unfit != c.reject_commanded + decided ||
        c.reject_commanded != c.reject_confirmed + c.reject_failed + c.reject_late + commanded) {
        violation("the counters disagree", r.part);
    }

    Known* known = arrived_at(r.arrived_ns);
    if (known == nullptr) return;  // a ghost edge: no part was there
    if (known->has_result) return violation("has two verdicts", known->number);
    known->has_result = true;
    known->result = r;
    if (r.verdict == PartVerdict::pass) {
        const Judgement& judgement = judgements_[r.part % kMemory];
        if (judgement.part != r.part || judgement.judged_by != known->number) {
            violation("passed by the frame of part " + std::to_string(judgement.judged_by), known->number);
        }
        if (known->bad && perfect_) violation("bad, and passed", known->number);
        if (known->bad && !perfect_) ++passed_bad_;
    }
    if (known->gone) settle(*known);
}

void Invariants::settle(Known& part) {
    const bool passed = part.result.verdict == PartVerdict::pass;
    if (part.ejected && passed) {
        if (part.stood_still) return;
        excuse(Excuse::ejected, {Fault::reject_late, Fault::reject_twice, Fault::encoder_slip}, "passed, and ejected", part.number);
    }
    if (!part.ejected && !passed && part.result.reject == RejectState::confirmed) {
        excuse(Excuse::not_ejected, {Fault::ejector_stuck, Fault::encoder_slip}, "its rejection is confirmed, and it left", part.number);
    }
}

void Invariants::end(const Core& core, hal::Duration longest_light, hal::Duration limit) {
    if (core.snapshot().counters.seen != results_ + core.line().size()) violation("parts seen and results disagree", core.snapshot().counters.seen);
    if (longest_light > limit) violation("a light was on longer than its limit", 0);
}

}  // namespace hord::firmware
