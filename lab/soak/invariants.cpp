// What truly happens: parts, faults, light and ejector, and whether a part may leave or be ejected.
#include "lab/soak/invariants.h"

#include <algorithm>

namespace hord::lab {

using sim::Fault;

namespace {

constexpr std::array<std::string_view, kPromises> kNames{
    "one-verdict",    "no-bad-part-passes", "own-data",     "own-rejection",     "unconfirmed-stops", "light-limits",
    "counters-agree", "lawful-states",      "true-reasons", "undisturbed-parts", "ready-again",       "bounded",
    "one-story",      "commands-once"};

// The encoder may lose so much while a part is on its way, and it is still exposed and ejected.
constexpr double kSlipBorne_mm = 4;

// What a fault disturbs, it disturbs for its amount and so much longer: frames are awaited, rejections confirmed.
constexpr Duration kAftermath = milliseconds(1000);

// Neither a verdict nor the line may care: parts that come meanwhile are held to what holds when nothing is wrong.
bool harmless(Fault fault) { return fault >= Fault::scada_floods && fault <= Fault::clock_set; }

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
    Known& known = parts_[part.number % kMemory];
    if (known.number != 0) forget(known);
    known = Known{};
    known.number = part.number;
    known.bad = part.bad;
    known.front_mm = part.front_mm;
    known.arrived_ns = part.arrived.time_since_epoch().count();
    // It hides behind one whose edge was lost without a trace: the sensor is covered all the time, and says nothing of
    // it.
    known.invisible = part.touches_ahead && newest_ != 0 && parts_[newest_ % kMemory].invisible;
    // So close behind the one ahead that it may be rejected, or its light may not have rested.
    const Known& ahead = parts_[newest_ % kMemory];
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

// Its story must be over.
void Invariants::forget(const Known& known) {
    if (!known.gone)
        broken(Promise::bounded, "is still on the line " + std::to_string(kMemory) + " parts later", known.number);
    if (known.delivered && !known.has_result && !known.process_ended)
        broken(Promise::one_verdict, "was seen and got no verdict", known.number);
}

Invariants::Known* Invariants::arrived_at(std::int64_t ns) {
    for (std::uint64_t number = newest_; number > 0 && number + kMemory > newest_; --number) {
        Known& known = parts_[number % kMemory];
        if (known.arrived_ns == ns) return &known;
        if (known.arrived_ns < ns) return nullptr;  // nothing came then: a ghost
    }
    return nullptr;
}

Invariants::Known* Invariants::known_as(std::uint32_t station_part) {
    const Line& line = core_->line();
    for (std::uint32_t k = line.size(); k-- > 0;) {
        if (line[k].number() == station_part) return arrived_at(line[k].arrived.time_since_epoch().count());
    }
    return nullptr;
}

void Invariants::part_is_gone(const sim::PartRecord& part) {
    Known& known = parts_[part.number % kMemory];
    if (known.number != part.number) return broken(Promise::bounded, "left before it came", part.number);
    known.gone = true;
    switch (part.fate) {
        case sim::PartRecord::Fate::ejected: check_ejected(known); break;
        case sim::PartRecord::Fate::left: check_exit(known); break;
        case sim::PartRecord::Fate::removed: known.taken_by_hand = true; break;
        case sim::PartRecord::Fate::on_line: break;
    }
}

// The one rule that all this is about: what leaves the line was passed.
void Invariants::check_exit(Known& known) {
    if (known.has_result && known.result.verdict == PartVerdict::pass) return;
    if (known.invisible || known.stuck || known.slipped_mm > kSlipBorne_mm) {
        ++excused_;
        return;
    }
    // A process that does not run can stop no line: the next one must, before the belt moves on.
    if (core_ == nullptr || clock_.now() <= stalled_until_ + milliseconds(20)) {
        left_in_outage_at_ = clock_.now().time_since_epoch().count();
        return;
    }
    broken(Promise::no_bad_part_passes,
           known.has_result ? "left, and was not passed (" + std::string(name_of(known.result.reason)) + ")"
                            : "left without a verdict",
           known.number);
}

void Invariants::check_ejected(Known& known) {
    known.ejected = true;
    if (known.commanded || !known.delivered || known.process_ended) return;
    if (belt_stands()) return;  // it came to rest before the ejector while a pulse was under way: a good part lost
    if (by_itself(clock_.now()) || known.slipped_mm > kSlipBorne_mm) {
        ++excused_;
        return;
    }
    broken(Promise::own_rejection, "was ejected, and nobody told the ejector to", known.number);
}

bool Invariants::by_itself(TimePoint at) const {
    return std::any_of(own_accord_.begin(), own_accord_.end(), [&](const Pulse& p) {
        return at + milliseconds(1) >= p.from && at <= p.until + milliseconds(1);
    });
}

// -- faults

void Invariants::fault(Fault fault, Duration amount) {
    const TimePoint now = clock_.now();
    TimePoint& felt_until = felt_until_[static_cast<std::size_t>(fault)];
    felt_until = std::max(felt_until, now + amount);
    if (harmless(fault)) return;
    faults_until_ = std::max(faults_until_, now + amount + kAftermath);
    disturbed_until_ = std::max(disturbed_until_, faults_until_);
    told_not_ready_ = false;
    const auto mm_in = [&](Duration motion) {
        return 1e-9 * static_cast<double>(motion.count()) * cell_.world().nominal_speed_mm_s();
    };
    switch (fault) {
        case Fault::process_stalled: stalled_until_ = std::max(stalled_until_, now + amount); break;
        case Fault::edge_missed: parts_[newest_ % kMemory].invisible = true; break;
        case Fault::encoder_slip:
            for (Known& known : parts_) {
                if (known.number != newest_ && !known.gone) known.slipped_mm += mm_in(amount);
            }
            slipped_at_ = now;
            slipped_mm_ = mm_in(amount);
            if (now < encoder_silent_until_) parts_[newest_ % kMemory].slipped_mm += slipped_mm_;
            break;
        case Fault::encoder_silent:
            // The newest part's edge has no count of its own, then: its place is reckoned from before the slip.
            if (slipped_at_ == now && now >= encoder_silent_until_) parts_[newest_ % kMemory].slipped_mm += slipped_mm_;
            encoder_silent_until_ = std::max(encoder_silent_until_, now + amount);
            break;
        case Fault::ejector_stuck:
            if (Known* known = known_as(rejecting_.part)) known->stuck = true;
            break;
        case Fault::reject_late: {
            const TimePoint from = std::max(rejecting_.start, now) + amount;
            own_accord_[next_own_accord_++ % own_accord_.size()] = {from, from + rejecting_.width};
            break;
        }
        case Fault::reject_twice: {
            const TimePoint from = rejecting_.start + rejecting_.width + amount;
            own_accord_[next_own_accord_++ % own_accord_.size()] = {from, from + rejecting_.width};
            break;
        }
        default: break;
    }
}

bool Invariants::any_felt(std::uint64_t faults, TimePoint since) const {
    for (std::size_t k = 0; k < sim::kFaults; ++k) {
        if ((faults >> k & 1U) != 0 && felt_until_[k] != TimePoint{} && felt_until_[k] >= since) return true;
    }
    return false;
}

// -- processes

void Invariants::process_starts(const Core& core, const CoreConfig& config) {
    core_ = &core;
    rules_.core = config;
    told_ = counted_ = {};
    counted_results_ = 0;
    told_inspected_ = results_in_process_ = 0;
    data_.fill({});
}

void Invariants::process_ends() {
    core_ = nullptr;
    part_sensor_up_ = false;
    for (Known& known : parts_) known.process_ended = known.process_ended || !known.has_result;
}

// -- the gates

void Invariants::edge_delivered(const hal::PartEdge& edge) {
    if (Known* known = arrived_at(edge.at.time_since_epoch().count())) known->delivered = true;
}

Invariants::OwnData& Invariants::data_of(std::uint32_t station_part) {
    OwnData& data = data_[station_part % kMemory];
    if (data.part != station_part) data = {};
    data.part = station_part;
    return data;
}

void Invariants::lit(const hal::StrobePulse& pulse) {
    const hal::StrobeLimits limits = cell_.strobe().limits();
    if (pulse.width > limits.max_on) broken(Promise::light_limits, "a light is on longer than its limit");
    if (ever_lit_ && pulse.start < light_until_ + limits.min_rest)
        broken(Promise::light_limits, "a light did not rest");
    light_until_ = pulse.start + pulse.width;
    ever_lit_ = true;
    data_of(pulse.exposure).pulse = pulse;
}

void Invariants::strobe_reported(const hal::StrobeReport& report) {
    OwnData& data = data_of(report.exposure);
    const Duration off =
        report.start > data.pulse.start ? report.start - data.pulse.start : data.pulse.start - report.start;
    const Duration wide =
        report.width > data.pulse.width ? report.width - data.pulse.width : data.pulse.width - report.width;
    data.lit_right = report.lit && off <= rules_.core.strobe_window && wide <= rules_.core.strobe_window;
}

void Invariants::submitted(std::uint32_t station_part, const hal::FrameInfo& frame, std::uint64_t true_part) {
    OwnData& data = data_of(station_part);
    if (data.submitted)
        broken(Promise::own_data, "two frames were inspected for station part " + std::to_string(station_part));
    data.submitted = true;
    data.true_part = true_part;
    const TimePoint asked = data.pulse.start - rules_.core.strobe_delay;
    const Duration off = frame.exposure_start > asked ? frame.exposure_start - asked : asked - frame.exposure_start;
    data.frame_right =
        !frame.corrupt && frame.bytes_used >= core_->config().frame_bytes && off <= rules_.core.frame_window;
}

void Invariants::judged(const Judged& judged) {
    data_of(judged.part).judged_good = !judged.failed && judged.verdict == algo::Verdict::pass;
}

void Invariants::rejecting(const hal::RejectCommand& command) {
    rejecting_ = command;
    Known* known = known_as(command.part);
    if (known == nullptr) return;
    if (known->commanded) broken(Promise::own_rejection, "is commanded to be rejected twice", known->number);
    if (known->has_result && known->result.verdict == PartVerdict::pass)
        broken(Promise::own_rejection, "was passed, and is rejected", known->number);
}

void Invariants::rejecting_done(bool accepted) {
    Known* known = known_as(rejecting_.part);
    if (known != nullptr && accepted) known->commanded = true;
}

}  // namespace hord::lab
