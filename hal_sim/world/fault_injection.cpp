#include "hal_sim/world/fault_injection.h"

#include <utility>

#include "hal_sim/world/random.h"

namespace hord::sim {
namespace {

using namespace std::chrono_literals;

struct Row {
    std::string_view name;
    hal::Duration amount;
};
constexpr std::array<Row, kInjectedFaults> kRows = {{
    {"frame-drop", 0ns},         {"frame-duplicate", 0ns},    {"frame-stale", 0ns},      {"frame-late", 200ms},
    {"frame-short", 0ns},        {"frame-corrupt", 0ns},      {"frame-dark", 0ns},       {"frame-saturated", 0ns},
    {"sensor-lost", 100ms},      {"strobe-dead", 0ns},        {"strobe-refused", 0ns},   {"strobe-weak", 0ns},
    {"strobe-double", 50us},     {"strobe-late", 2ms},        {"strobe-lost", 100ms},    {"edge-bounce", 200us},
    {"edge-lost", 0ns},          {"edge-missed", 0ns},        {"edge-ghost", 10ms},      {"encoder-slip", 1ms},
    {"encoder-silent", 300ms},   {"part-sensor-lost", 100ms}, {"reject-lost", 0ns},      {"reject-unacknowledged", 0ns},
    {"reject-late", 100ms},      {"reject-twice", 20ms},      {"ejector-stuck", 0ns},    {"rejector-down", 100ms},
    {"part-close", 0ns},         {"part-touching", 0ns},      {"part-missing", 0ns},     {"part-removed", 150ms},
    {"belt-stop", 300ms},        {"inspector-slow", 1000ms},  {"inspector-failed", 0ns}, {"process-stalled", 120ms},
    {"process-crash", 400ms},    {"restart-ordered", 0ns},    {"plc-silent", 3000ms},    {"plc-repeats", 0ns},
    {"plc-commands", 0ns},       {"plc-nonsense", 0ns},       {"scada-floods", 0ns},     {"store-error", 1s},
    {"store-in-doubt", 1s},      {"store-slow", 2s},          {"disk-full", 3s},         {"clock-set", 1h},
    {"inspector-hangs", 1500ms}, {"device-unplugged", 300ms}, {"plc-walks", 1500ms},     {"strobe-short", 22us},
    {"trigger-late", 60ms},      {"plc-orders", 1s},          {"belt-coasts", 60ms},
}};

}  // namespace

std::string_view name_of(InjectedFault fault) { return kRows[static_cast<std::size_t>(fault)].name; }

std::optional<InjectedFault> injected_fault_named(std::string_view name) {
    for (std::size_t k = 0; k < kInjectedFaults; ++k) {
        if (kRows[k].name == name) return static_cast<InjectedFault>(k);
    }
    return std::nullopt;
}

InjectionPlan::InjectionPlan(std::uint64_t seed, std::vector<InjectionRule> rules) : seed_(seed) {
    for (InjectionRule& rule : rules) {
        if (rule.amount == 0ns) rule.amount = kRows[index(rule.fault)].amount;
        tracks_[index(rule.fault)].rules.push_back(rule);
    }
}

void InjectionPlan::fire_next(InjectedFault fault, hal::Duration amount) {
    tracks_[index(fault)].next = amount == 0ns ? kRows[index(fault)].amount : amount;
}

std::optional<hal::Duration> InjectionPlan::fires(InjectedFault fault) {
    Track& track = tracks_[index(fault)];
    const std::uint64_t opportunity = track.opportunities++;
    if (track.next) return fire(track, fault, *std::exchange(track.next, std::nullopt));
    if (track.rules.empty()) return std::nullopt;
    for (const InjectionRule& rule : track.rules) {
        if (opportunity < rule.first || opportunity > rule.last) continue;
        if (random_unit(seed_, 0xFA00U + index(fault), opportunity) >= rule.probability) continue;
        return fire(track, fault, rule.amount);
    }
    return std::nullopt;
}

std::optional<hal::Duration> InjectionPlan::fire(Track& track, InjectedFault fault, hal::Duration amount) {
    ++track.fired;
    if (watcher_) watcher_(fault, amount);
    return amount;
}

std::vector<InjectedFault> InjectionPlan::never_fired() const {
    std::vector<InjectedFault> out;
    for (std::size_t k = 0; k < kInjectedFaults; ++k) {
        if (!tracks_[k].rules.empty() && tracks_[k].fired == 0) out.push_back(static_cast<InjectedFault>(k));
    }
    return out;
}

}  // namespace hord::sim
