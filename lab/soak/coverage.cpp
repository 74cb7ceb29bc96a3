#include "lab/soak/coverage.h"

#include <algorithm>
#include <vector>

namespace hord::lab {

using namespace firmware;
using sim::InjectedFault;

namespace {

constexpr std::size_t kUp = kStateCommands, kLost = kUp + kDevices, kEdges = kLost + kDevices, kOthers = kEdges + 2;

// In the order of kind_of(), behind the commands.
constexpr std::array<std::string_view, kEventKinds - kUp> kNames{
    "part-sensor-up", "strobe-up",       "sensor-up",      "rejector-up",     "part-sensor-lost",
    "strobe-lost",    "sensor-lost",     "rejector-lost",  "part-arrives",    "part-leaves",
    "tick",           "encoder",         "frame",          "strobe-report",   "judged",
    "reject-report",  "trigger-refused", "strobe-refused", "inspect-refused", "reject-refused",
    "plc-lost",       "plc-back",        "line-unknown",   "outside-faults"};

struct KindOf {
    std::size_t operator()(const Command& c) const { return static_cast<std::size_t>(c) - 1; }
    std::size_t operator()(const DeviceUp& e) const { return kUp + static_cast<std::size_t>(e.device); }
    std::size_t operator()(const DeviceLost& e) const { return kLost + static_cast<std::size_t>(e.device); }
    std::size_t operator()(const hal::PartEdge& e) const {
        return kEdges + (e.kind == hal::PartEdge::Kind::arrives ? 0U : 1U);
    }
    std::size_t operator()(const Tick&) const { return kOthers; }
    std::size_t operator()(const hal::EncoderReading&) const { return kOthers + 1; }
    std::size_t operator()(const FrameArrived&) const { return kOthers + 2; }
    std::size_t operator()(const hal::StrobeReport&) const { return kOthers + 3; }
    std::size_t operator()(const Judged&) const { return kOthers + 4; }
    std::size_t operator()(const hal::RejectReport&) const { return kOthers + 5; }
    std::size_t operator()(const TriggerRefused&) const { return kOthers + 6; }
    std::size_t operator()(const StrobeRefused&) const { return kOthers + 7; }
    std::size_t operator()(const InspectRefused&) const { return kOthers + 8; }
    std::size_t operator()(const RejectRefused&) const { return kOthers + 9; }
    std::size_t operator()(const PlcLost&) const { return kOthers + 10; }
    std::size_t operator()(const PlcBack&) const { return kOthers + 11; }
    std::size_t operator()(const LineUnknown&) const { return kOthers + 12; }
    std::size_t operator()(const OutsideFaults&) const { return kOthers + 13; }
};

std::string padded(std::string_view text, std::size_t width) {
    std::string out(text);
    out.resize(std::max(width, out.size()), ' ');
    return out;
}

}  // namespace

std::size_t kind_of(const Event& event) { return std::visit(KindOf{}, event); }
std::string name_of_kind(std::size_t kind) {
    return kind < kUp ? hyphenated_name_of(static_cast<Command>(kind + 1)) : std::string(kNames[kind - kUp]);
}

std::size_t Coverage::index_of(State state) {
    return static_cast<std::size_t>(std::find(kStates.begin(), kStates.end(), state) - kStates.begin());
}

void Coverage::merge(const Coverage& other) {
    for (std::size_t s = 0; s < steps_.size(); ++s) {
        for (std::size_t k = 0; k < kEventKinds; ++k) steps_[s][k] += other.steps_[s][k];
    }
    pairs_ |= other.pairs_;
}

bool Coverage::together(InjectedFault a, InjectedFault b) const {
    const auto x = static_cast<std::size_t>(a), y = static_cast<std::size_t>(b);
    return pairs_[x * sim::kInjectedFaults + y] || pairs_[y * sim::kInjectedFaults + x];
}

std::size_t Coverage::pairs() const {
    std::size_t n = 0;
    for (std::size_t a = 0; a < sim::kInjectedFaults; ++a) {
        for (std::size_t b = 0; b < a; ++b)
            n += together(static_cast<InjectedFault>(a), static_cast<InjectedFault>(b)) ? 1U : 0U;
    }
    return n;
}

std::string_view unreachable(State state, std::size_t kind) {
    const bool closed = state == State::preoperational || state == State::halted;
    const bool from_device = (kind >= kUp && kind < kOthers) || (kind > kOthers && kind <= kOthers + 9);
    const std::size_t strobe_report = kOthers + 3, reject_report = kOthers + 5, first_refusal = kOthers + 6,
                      reject_refused = kOthers + 9, line_unknown = kOthers + 12;
    if (closed && from_device && !(state == State::halted && (kind == strobe_report || kind == reject_report))) {
        return "devices are closed; what they still owe is told as they are closed, in Halted";
    }
    if (kind == line_unknown && state != State::preoperational) return "it is told before the station runs";
    if (kind >= kUp && kind < kLost && (state == State::ready || executing(state))) {
        return "a device that goes there brings Error, and one that is down lets nobody arm";
    }
    if (kind == reject_refused)
        return "the simulated rejector takes as many commands as its ledger, more than there are parts; the core's own "
               "tests refuse";
    if (state == State::error && kind == first_refusal + 1) {
        return "only where the strobe goes in the very pulse that was planned up to 5 ms before the Error: not met in "
               "millions; the core's own tests refuse it";
    }
    if (kind >= first_refusal && kind < reject_refused && (state == State::initialized || state == State::ready)) {
        return "no part that waits for its exposure or its frame is left: to get there the line was emptied, stood, or "
               "its parts were given up";
    }
    return {};
}

std::string describe(const Coverage& coverage, bool* complete) {
    bool all = true;
    std::string text = padded("event", 18);
    for (const State state : kStates) text += padded(name_of(state).substr(0, 9), 11);
    text += "\n";
    std::vector<std::string_view> reasons;  // numbered in order of appearance
    for (std::size_t kind = 0; kind < kEventKinds; ++kind) {
        text += padded(name_of_kind(kind), 18);
        for (const State state : kStates) {
            const std::uint64_t n = coverage.steps(state, kind);
            const std::string_view why = unreachable(state, kind);
            const auto known = std::find(reasons.begin(), reasons.end(), why);
            const auto number = static_cast<std::size_t>(known - reasons.begin()) + 1;
            if (n == 0 && !why.empty() && known == reasons.end()) reasons.push_back(why);
            // An event that occurs but is listed as unreachable is an error, too.
            text += padded(n > 0             ? (why.empty() ? "" : "UNEXPECTED ") + std::to_string(n)
                               : why.empty() ? "MISSING"
                                             : "(" + std::to_string(number) + ")",
                           11);
            all = all && (n > 0) == why.empty();
        }
        text += "\n";
    }
    std::string missing;
    std::size_t reachable = 0;
    for (std::size_t a = 0; a < sim::kInjectedFaults; ++a) {
        for (std::size_t b = 0; b < a; ++b) {
            const auto x = static_cast<InjectedFault>(a), y = static_cast<InjectedFault>(b);
            ++reachable;
            if (!coverage.together(x, y))
                missing += "  " + std::string(sim::name_of(y)) + " + " + std::string(sim::name_of(x)) + "\n";
        }
    }
    all = all && missing.empty();
    text += "fault pairs " + std::to_string(coverage.pairs()) + " of " + std::to_string(reachable) + "\n";
    if (!missing.empty()) text += "pairs not seen\n" + missing;
    for (std::size_t k = 0; k < reasons.size(); ++k)
        text += "(" + std::to_string(k + 1) + ") " + std::string(reasons[k]) + "\n";
    if (complete != nullptr) *complete = all;
    return text;
}

}  // namespace hord::lab
