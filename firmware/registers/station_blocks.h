// Rows of IDENT, STATUS, COUNTERS, LAST and RING. Append only.
#pragma once

#include <algorithm>
#include <array>
#include <span>

#include "firmware/core/enum_values.h"
#include "firmware/core/events.h"
#include "firmware/core/states.h"
#include "firmware/registers/register_rows.h"

namespace hord::firmware::rows {

inline constexpr NamedValue kStatusBits[] = {
    {0, "executing"},     {1, "run_permit"}, {2, "line_stop"},       {3, "fault_active"},
    {4, "fault_latched"}, {5, "error"},      {6, "results_overrun"}, {7, "plc_lost"},
};
inline constexpr auto kFaultBits = [] {
    std::array<NamedValue, kFaultCount> bits{};
    for (std::uint32_t k = 0; k < kFaultCount; ++k) bits[k] = {k, kFaultTable[k].name};
    return bits;
}();
inline constexpr auto kFirstFaults = [] {
    std::array<NamedValue, kFaultCount + 1> numbers{{{0, "none"}}};
    for (std::uint32_t k = 0; k < kFaultCount; ++k) numbers[k + 1] = {k + 1, kFaultTable[k].name};
    return numbers;
}();
// The map was released with "not_needed"; everywhere else it is "not-needed".
inline constexpr auto kRejectStates = [] {
    auto names = kNamesOf<RejectState>;
    names[0].name = "not_needed";
    return names;
}();
inline constexpr NamedValue kResultFlags[] = {{0, "judged"}, {1, "rejected"}, {2, "bounded"}};

inline constexpr Register kIdent[] = {
    number(2, Type::bits32, "magic", "", "0x484F5244, \"HORD\": this is the right device and the right byte order",
           [](const Source&) -> Number { return kMapMagic; }),
    number(4, Type::u16, "map_version", "", "version of this map; rows are only ever added",
           [](const Source&) -> Number { return kMapVersion; }),
    number(5, Type::bits32, "map_crc32", "",
           "CRC-32 of the table: equal means that every row is where the reader expects it",
           [](const Source&) -> Number { return map_crc32(); }),
    number(7, Type::bits32, "boot_id", "",
           "changes at every start: result sequences of different boots must not be compared",
           [](const Source& s) -> Number { return s.identity.boot_id; }),
    text(9, 16, "vendor", "device identification object 0x00",
         [](const Source& s) -> std::string_view { return s.identity.vendor; }),
    text(25, 16, "product", "device identification objects 0x01 and 0x04",
         [](const Source& s) -> std::string_view { return s.identity.product; }),
    text(41, 16, "firmware", "version; device identification object 0x02",
         [](const Source& s) -> std::string_view { return s.identity.firmware; }),
    text(57, 16, "serial", "device identification object 0x80",
         [](const Source& s) -> std::string_view { return s.identity.serial; }),
};

inline constexpr Register kStatus[] = {
    number(102, Type::u16, "state", "", "OPC 40100-1 state", snapshot<&Snapshot::state>, kNamesOf<State>),
    number(
        103, Type::bits16, "bits", "", "what a PLC interlocks on",
        [](const Source& s) -> Number {
            const Snapshot& now = s.snapshot;
            const bool executing = now.state == State::single_execution || now.state == State::continuous_execution;
            return (executing ? 1 : 0) | (now.run_permit ? 2 : 0) | (now.line_stop ? 4 : 0) |
                (now.faults_active != 0 ? 8 : 0) | (now.faults_latched != 0 ? 16 : 0) |
                (now.state == State::error ? 32 : 0) | (s.extras.plc && s.extras.plc->overruns > 0 ? 64 : 0) |
                (s.extras.plc && s.extras.plc->lost ? 128 : 0);
        },
        kStatusBits),
    number(104, Type::bits16, "heartbeat", "", "counts while the station lives; wraps",
           snapshot<&Snapshot::station_heartbeat>),
    number(105, Type::u16, "plc_heartbeat_age", "ms", "since the PLC's heartbeat last changed",
           [](const Source& s) { return s.extras.plc ? maybe(s.extras.plc->plc_heartbeat_age_ms) : Number{}; }),
    number(106, Type::u32, "last_sequence", "", "newest result; 0: none since this boot",
           [](const Source& s) -> Number { return s.result.sequence; }),
    number(108, Type::u32, "oldest_sequence", "", "oldest result that the ring still holds; 0: none",
           [](const Source& s) -> Number {
               const std::uint32_t newest = s.result.sequence;
               return newest <= kRingSlots ? std::min(newest, 1U) : newest - (kRingSlots - 1);
           }),
    number(110, Type::u16, "recipe", "", "number of the recipe in use",
           [](const Source& s) { return maybe(s.extras.recipe.number); }),
    number(111, Type::bits32, "recipe_crc32", "", "CRC-32 of the recipe in use; 0: not known",
           [](const Source& s) -> Number { return s.extras.recipe.crc32.value_or(0); }),
    number(113, Type::bits32, "faults_active", "", "faults that are present now", snapshot<&Snapshot::faults_active>,
           kFaultBits),
    number(115, Type::bits32, "faults_latched", "", "faults since the last reset", snapshot<&Snapshot::faults_latched>,
           kFaultBits),
    number(117, Type::u16, "first_fault", "", "the fault that came first since the last reset",
           snapshot<&Snapshot::first_fault>, kFirstFaults),
    number(118, Type::u32, "parts_on_line", "parts", "between part sensor and rejector",
           snapshot<&Snapshot::parts_on_line>),
    number(
        120, Type::bits16, "simulated", "", "devices that are not real: simulated, or recorded frames; 0 on a line",
        [](const Source& s) -> Number { return s.identity.simulated; }, std::span(kFaultBits).first(kDevices)),
    number(121, Type::bits32, "boot_id", "",
           "as in IDENT: last_sequence belongs to this start, and one request reads both",
           [](const Source& s) -> Number { return s.identity.boot_id; }),
    number(
        123, Type::bits32, "commands", "", "that the state allows; others are refused with not_in_this_state",
        [](const Source& s) -> Number {
            std::uint32_t bits = 0;
            for (const Command command : kValuesOf<Command>)
                bits |= is_possible(s.snapshot.state, command) ? 1U << static_cast<unsigned>(command) : 0U;
            return bits;
        },
        kNamesOf<Command>),
    number(
        125, Type::u16, "next_command", "",
        "that brings the station nearer to inspecting every part; 65535: none, it inspects",
        [](const Source& s) -> Number {
            const auto next = next_command(s.snapshot.state);
            return next ? Number(static_cast<double>(*next)) : Number{};
        },
        kNamesOf<Command>),
};

inline constexpr Register kCounters[] = {
    number(142, Type::u32, "seen", "parts", "edges of the part sensor taken as parts", counter<&Counters::seen>),
    number(144, Type::u32, "inspected", "parts", "parts with a frame that was judged", counter<&Counters::inspected>),
    number(146, Type::u32, "pass", "parts", "verdict pass", counter<&Counters::pass>),
    number(148, Type::u32, "reject", "parts", "verdict reject", counter<&Counters::reject>),
    number(150, Type::u32, "unfit", "parts", "could not be judged; rejected to be safe", counter<&Counters::unfit>),
    number(152, Type::u32, "missed", "parts", "passed the rejector without any decision", counter<&Counters::missed>),
    number(154, Type::u32, "reject_commanded", "parts",
           "rejections that were due: confirmed, failed, late and under way", counter<&Counters::reject_commanded>),
    number(156, Type::u32, "reject_confirmed", "parts", "rejections that the ejector acknowledged in time",
           counter<&Counters::reject_confirmed>),
    number(158, Type::u32, "reject_failed", "parts",
           "rejections never acknowledged, or of a part whose place was lost; line stop",
           counter<&Counters::reject_failed>),
    number(160, Type::u32, "reject_late", "parts",
           "rejections commanded or acknowledged too late for the part; line stop", counter<&Counters::reject_late>),
};

// One result in 24 registers, the same in LAST and in the ring. The sequence number stands at both ends: they differ
// when the slot was overwritten between two requests of a reader.
inline Number of_result(const Source& s, double value) { return s.result.sequence == 0 ? Number{} : Number{value}; }

template <auto member>
Number result(const Source& s) {
    return of_result(s, static_cast<double>(s.result.*member));
}
// The same for members that may be kNoNumber.
template <auto member>
Number known(const Source& s) {
    return s.result.*member == kNoNumber ? Number{} : result<member>(s);
}

template <std::uint16_t base>
inline constexpr std::array<Register, 16> kResult = {{
    number(base + 0, Type::u32, "sequence", "", "result number since this boot, from 1; 0: no result yet",
           [](const Source& s) -> Number { return s.result.sequence; }),
    number(base + 2, Type::u32, "part", "",
           "part number since the start, from 1; results do not come in this order: sort by it",
           result<&PartResult::part>),
    number(base + 4, Type::u32, "arrived_s", "s", "when the part reached the sensor: the station's monotonic clock",
           [](const Source& s) { return of_result(s, static_cast<double>(s.result.arrived_ns / 1'000'000'000)); }),
    number(base + 6, Type::u32, "arrived_us", "us", "the same, microseconds within the second",
           [](const Source& s) { return of_result(s, static_cast<double>(s.result.arrived_ns / 1000 % 1'000'000)); }),
    number(base + 8, Type::u16, "verdict", "", "everything but pass is rejected", result<&PartResult::verdict>,
           kNamesOf<PartVerdict>),
    number(base + 9, Type::u16, "reason", "", "below 16: judged; from 16: a way of not having a verdict",
           result<&PartResult::reason>, kNamesOf<PartReason>),
    number(base + 10, Type::u16, "defects", "", "defects found", result<&PartResult::defects>),
    number(base + 11, Type::u32, "score", "", "worst value over its limit: above 1 is rejected",
           result<&PartResult::score>, {}, 0.001),
    number(base + 13, Type::u32, "latency", "us", "from the part sensor's edge to the verdict",
           result<&PartResult::latency_us>),
    number(base + 15, Type::u32, "reject_latency", "us", "from the edge to the confirmed rejection",
           [](const Source& s) {
               return s.result.reject_latency_us == 0 ? Number{} : of_result(s, s.result.reject_latency_us);
           }),
    number(base + 17, Type::u16, "reject_state", "", "how the rejection ended; without confirmation: failed or late",
           result<&PartResult::reject>, kRejectStates),
    number(base + 18, Type::u16, "position_m", "lenslets", "column of the worst defect's centre",
           known<&PartResult::position_m>),
    number(base + 19, Type::u16, "position_n", "lenslets", "row of the worst defect's centre",
           known<&PartResult::position_n>),
    number(base + 20, Type::u16, "recipe", "", "number of the recipe that judged", known<&PartResult::recipe>),
    number(
        base + 21, Type::bits16, "flags", "",
        "how the result came about; bounded: score and defects may be upper bounds",
        [](const Source& s) -> Number {
            if (s.result.sequence == 0) return 0;
            const bool judged = is_judged(s.result.reason);
            return (judged ? 1 : 0) | (s.result.verdict != PartVerdict::pass ? 2 : 0) | (s.result.bounded ? 4 : 0);
        },
        kResultFlags),
    number(base + 22, Type::u32, "sequence_again", "",
           "equal to `sequence`, or the slot was overwritten while it was read",
           [](const Source& s) -> Number { return s.result.sequence; }),
}};

}  // namespace hord::firmware::rows
