#include "lab/soak/plan.h"

#include <algorithm>
#include <charconv>
#include <cstdlib>

#include "hal_sim/world/random.h"

namespace hord::lab {
namespace {

using sim::InjectedFault;
using sim::InjectionRule;
using namespace std::chrono_literals;

constexpr std::uint64_t kPlanStream = 0x50A7;

// Faults that are not drawn among the others, so that their plans stay the same: those of draw_plan().
constexpr std::size_t kDrawnFaults = static_cast<std::size_t>(InjectedFault::plc_orders) + 1;

// A fault's number of opportunities in `parts` parts. Rejections have fewer: at most one part in ten is rejected.
std::uint64_t opportunities(InjectedFault fault, std::uint64_t parts) {
    return fault >= InjectedFault::reject_lost && fault <= InjectedFault::rejector_down ? parts / 12 : parts * 9 / 10;
}

// Faults that may strike only rarely: they stop the line for a second or kill the process.
bool rare(InjectedFault fault) {
    return fault == InjectedFault::sensor_lost || fault == InjectedFault::strobe_lost ||
        fault == InjectedFault::part_sensor_lost || fault == InjectedFault::encoder_silent ||
        fault == InjectedFault::inspector_hangs || fault == InjectedFault::device_unplugged ||
        fault == InjectedFault::plc_walks || fault == InjectedFault::process_crash ||
        fault == InjectedFault::plc_silent || fault == InjectedFault::plc_commands ||
        fault == InjectedFault::restart_ordered || fault == InjectedFault::rejector_down;
}

// A drawn amount: the choices range from harmless to fatal. Zero: the fault's default.
hal::Duration draw_amount(InjectedFault fault, std::uint64_t bits) {
    const auto one_of = [&](std::initializer_list<hal::Duration> choices) {
        return choices.begin()[bits % choices.size()];
    };
    switch (fault) {
        case InjectedFault::frame_late: return one_of({20ms, 60ms, 200ms, 400ms});
        case InjectedFault::strobe_late: return one_of({30us, 100us, 300us, 2ms});
        case InjectedFault::strobe_double: return one_of({20us, 50us, 300us});
        case InjectedFault::strobe_short: return one_of({10us, 22us, 40us});
        case InjectedFault::edge_bounce: return one_of({200us, 2ms});
        case InjectedFault::edge_ghost: return one_of({10ms, 30ms, 55ms});
        case InjectedFault::encoder_slip: return one_of({1ms, 5ms, 20ms});
        case InjectedFault::encoder_silent: return one_of({12ms, 80ms, 300ms});
        case InjectedFault::reject_late: return one_of({3ms, 9ms, 12ms, 100ms});
        case InjectedFault::reject_twice: return one_of({20ms, 60ms});
        case InjectedFault::part_removed: return one_of({40ms, 150ms, 300ms, 700ms});
        case InjectedFault::belt_stop: return one_of({30ms, 300ms, 1500ms});
        case InjectedFault::inspector_slow:
            // Most are around 550 ms, when the verdict is due.
            return one_of({300ms, 530ms, 552ms, 556ms, 560ms, 564ms, 568ms, 1000ms});
        case InjectedFault::process_stalled: return one_of({10ms, 40ms, 120ms, 400ms});
        case InjectedFault::sensor_lost:
        case InjectedFault::strobe_lost:
        case InjectedFault::part_sensor_lost: return one_of({100ms, 700ms});
        case InjectedFault::plc_silent: return one_of({600ms, 1300ms, 3000ms});
        case InjectedFault::process_crash: return one_of({150ms, 400ms, 2000ms});
        case InjectedFault::store_error:
        case InjectedFault::store_in_doubt: return one_of({50ms, 1000ms, 4000ms});
        case InjectedFault::store_slow:
            return one_of({200ms, 2000ms, 4000ms});  // long enough that the queue of 24 overflows in some
        case InjectedFault::disk_full: return one_of({1000ms, 3000ms, 5000ms});
        case InjectedFault::inspector_hangs: return one_of({400ms, 700ms, 1500ms});
        case InjectedFault::device_unplugged: return one_of({100ms, 300ms, 700ms});
        case InjectedFault::plc_orders: return one_of({100ms, 1000ms, 2500ms});
        case InjectedFault::belt_coasts: return one_of({20ms, 60ms});
        case InjectedFault::plc_walks: return one_of({400ms, 1500ms, 2500ms});
        case InjectedFault::trigger_late: return one_of({1ms, 20ms, 60ms, 99ms, 101ms});
        case InjectedFault::clock_set: return one_of({2ms, 1000ms, 3600000ms});
        default: return {};
    }
}

}  // namespace

std::string_view name_of(LineProfile profile) { return profile == LineProfile::timed ? "timed" : "encoder"; }

bool possible(InjectedFault fault, LineProfile line) {
    return line == LineProfile::encoder ||
        (fault != InjectedFault::encoder_slip && fault != InjectedFault::encoder_silent &&
         fault != InjectedFault::belt_stop);
}

EpisodePlan draw_plan(std::uint64_t seed, std::uint64_t parts) {
    std::vector<InjectedFault> faults;
    std::uint64_t n = 1000;
    const std::uint64_t count = 1 + sim::random_bits(seed, kPlanStream, n++) % 4;
    while (faults.size() < count) {
        const auto fault = static_cast<InjectedFault>(sim::random_bits(seed, kPlanStream, n++) % kDrawnFaults);
        if (std::find(faults.begin(), faults.end(), fault) == faults.end()) faults.push_back(fault);
    }
    const bool ordered = sim::random_bits(seed, kPlanStream, 998) % 2 == 0;
    if (ordered && std::find(faults.begin(), faults.end(), InjectedFault::plc_orders) == faults.end())
        faults.push_back(InjectedFault::plc_orders);
    if (ordered && sim::random_bits(seed, kPlanStream, 997) % 2 == 0) faults.push_back(InjectedFault::belt_coasts);
    EpisodePlan plan = draw_plan(seed, parts, faults);
    plan.real = sim::random_bits(seed, kPlanStream, 999) % 50 == 0;
    return plan;
}

EpisodePlan draw_plan(std::uint64_t seed, std::uint64_t parts, const std::vector<InjectedFault>& faults) {
    EpisodePlan plan{seed, parts, seed % 2 == 0 ? LineProfile::timed : LineProfile::encoder, false, {}};
    if (!std::all_of(faults.begin(), faults.end(), [&](InjectedFault f) { return possible(f, plan.line); }))
        plan.line = LineProfile::encoder;
    auto draw = [&, n = std::uint64_t{0}]() mutable { return sim::random_bits(seed, kPlanStream, n++); };
    const std::uint64_t together = draw() % std::max<std::uint64_t>(parts / 10, 1);
    for (const InjectedFault fault : faults) {
        const std::uint64_t all = opportunities(fault, parts);
        const std::uint64_t first = std::min(all / 4, together * all / parts + draw() % 3);
        constexpr double kRates[] = {0.002, 0.01, 0.03};
        const double rate = rare(fault) ? 0.002 : fault == InjectedFault::plc_orders ? 0.01 : kRates[draw() % 3];
        plan.faults.push_back({fault, 1, first, first, draw_amount(fault, draw())});
        plan.faults.push_back({fault, rate, first + 1, all, draw_amount(fault, draw())});
    }
    return plan;
}

std::string text_of(const std::vector<InjectionRule>& faults) {
    std::string text;
    for (const InjectionRule& rule : faults) {
        if (!text.empty()) text += ",";
        text += std::string(sim::name_of(rule.fault)) + "@" + std::to_string(rule.first);
        if (rule.last == UINT64_MAX) text += "-";
        else if (rule.last != rule.first) text += "-" + std::to_string(rule.last);
        if (rule.probability < 1) {
            std::array<char, 32> digits{};
            const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), rule.probability).ptr;
            text += ":" + std::string(digits.data(), end);
        }
        if (rule.amount > 0ns) text += "+" + std::to_string(rule.amount / 1us) + "us";
    }
    return text;
}

Result<std::vector<InjectionRule>> faults_of(std::string_view text) {
    std::vector<InjectionRule> rules;
    const auto bad = [&](std::string_view what) {
        return fail(ErrorCode::invalid_argument, "fault '" + std::string(what) + "' cannot be read",
                    "write NAME, NAME@FIRST, NAME@FIRST-LAST, then :PROBABILITY and +TIMEus or ms as needed; several "
                    "with commas");
    };
    while (!text.empty()) {
        const std::string item(text.substr(0, text.find(',')));
        text.remove_prefix(std::min(text.size(), item.size() + 1));
        const std::size_t name_end = item.find_first_of("@:+");
        const auto fault = sim::injected_fault_named(item.substr(0, name_end));
        if (!fault) return bad(item);
        InjectionRule rule{.fault = *fault};
        const char* at = name_end == std::string::npos ? item.c_str() + item.size() : item.c_str() + name_end;
        char* end = nullptr;
        if (*at == '@') {
            rule.first = rule.last = std::strtoull(at + 1, &end, 10);
            if (end == at + 1) return bad(item);
            at = end;
            if (*at == '-') {
                rule.last = std::strtoull(at + 1, &end, 10);
                if (end == at + 1) rule.last = UINT64_MAX;
                at = end;
            }
        }
        if (*at == ':') {
            const char* stop = item.c_str() + item.size();
            const auto read = std::from_chars(at + 1, stop, rule.probability);
            if (read.ec != std::errc{}) return bad(item);
            at = read.ptr;
        }
        if (*at == '+') {
            const long amount = std::strtol(at + 1, &end, 10);
            const std::string_view unit(end);
            if (end == at + 1 || (unit != "us" && unit != "ms")) return bad(item);
            rule.amount = unit == "us" ? hal::Duration(amount * 1us) : hal::Duration(amount * 1ms);
            at = item.c_str() + item.size();
        }
        if (*at != '\0' || rule.probability < 0 || rule.probability > 1 || rule.last < rule.first) return bad(item);
        rules.push_back(rule);
    }
    return rules;
}

}  // namespace hord::lab
