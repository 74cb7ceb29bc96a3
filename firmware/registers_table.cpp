// The table itself. Rows are only ever appended to a block; nothing here moves.
#include "firmware/registers.h"

#include <array>

namespace hord::firmware {
namespace {

using Source = RegisterSource;
using Type = RegisterType;
using Number = std::optional<double>;

// -- names of values (those of reasons and faults are the core's: a test compares them)
// --------------------------

constexpr NamedValue kStates[] = {
    {1, name_of(State::preoperational)},
    {2, name_of(State::halted)},
    {3, name_of(State::error)},
    {5, name_of(State::initialized)},
    {6, name_of(State::ready)},
    {7, name_of(State::single_execution)},
    {8, name_of(State::continuous_execution)},
};
constexpr NamedValue kStatusBits[] = {
    {0, "executing"},    {1, "run_permit"},    {2, "line_stop"},
    {3, "fault_active"}, {4, "fault_latched"}, {5, "error"},
};
constexpr NamedValue kFaultBits[] = {
    {0, "part-sensor"}, {1, "strobe"},  {2, "sensor"},        {3, "rejector"},    {4, "reject-unconfirmed"},
    {5, "inspector"},   {6, "overrun"}, {7, "configuration"}, {8, "light-level"},
};
constexpr NamedValue kFirstFaults[] = {
    {0, "none"},          {1, "part-sensor"},        {2, "strobe"},    {3, "sensor"},
    {4, "rejector"},      {5, "reject-unconfirmed"}, {6, "inspector"}, {7, "overrun"},
    {8, "configuration"}, {9, "light-level"},
};
constexpr NamedValue kVerdicts[] = {{1, "pass"}, {2, "reject"}, {3, "unfit"}};
constexpr NamedValue kReasons[] = {
    {0, "none"},
    {1, "deflection"},
    {2, "slope"},
    {3, "absorption"},
    {4, "too-dark"},
    {5, "saturated"},
    {6, "nothing-to-see"},
    {16, "verdict-late"},
    {17, "frame-lost"},
    {18, "frame-stale"},
    {19, "frame-duplicate"},
    {20, "frame-short"},
    {21, "frame-corrupt"},
    {22, "strobe-failed"},
    {23, "parts-too-close"},
    {24, "station-not-running"},
    {25, "device-lost"},
    {26, "line-full"},
    {27, "edge-lost"},
    {28, "inspector-failed"},
};
constexpr NamedValue kRejectStates[] = {
    {0, "not_needed"}, {1, "commanded"}, {2, "confirmed"}, {3, "failed"}, {4, "late"},
};
constexpr NamedValue kResultFlags[] = {{0, "judged"}, {1, "rejected"}};

// -- rows --------------------------------------------------------------------------------------------------

constexpr Register number(std::uint16_t address, Type type, std::string_view name, std::string_view unit,
                          std::string_view meaning, Number (*read)(const Source&),
                          std::span<const NamedValue> values = {}, double scale = 1) {
    const bool two = type == Type::u32 || type == Type::s32 || type == Type::bits32;
    return {.address = address,
            .type = type,
            .words = static_cast<std::uint16_t>(two ? 2 : 1),
            .name = name,
            .unit = unit,
            .scale = scale,
            .meaning = meaning,
            .values = values,
            .number = read};
}
constexpr Register text(std::uint16_t address, std::uint16_t words, std::string_view name,
                        std::string_view meaning, std::string_view (*read)(const Source&)) {
    return {.address = address,
            .type = Type::text,
            .words = words,
            .name = name,
            .meaning = meaning,
            .text = read};
}

constexpr Register kIdent[] = {
    number(2, Type::bits32, "magic", "",
           "0x484F5244, \"HORD\": this is the right device and the right byte order",
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

constexpr Register kStatus[] = {
    number(
        102, Type::u16, "state", "", "OPC 40100-1 state",
        [](const Source& s) -> Number { return static_cast<double>(s.snapshot.state); }, kStates),
    number(
        103, Type::bits16, "bits", "", "what a PLC interlocks on",
        [](const Source& s) -> Number {
            const Snapshot& now = s.snapshot;
            const bool executing =
                now.state == State::single_execution || now.state == State::continuous_execution;
            return (executing ? 1 : 0) | (now.run_permit ? 2 : 0) | (now.line_stop ? 4 : 0) |
                   (now.faults_active != 0 ? 8 : 0) | (now.faults_latched != 0 ? 16 : 0) |
                   (now.state == State::error ? 32 : 0);
        },
        kStatusBits),
    number(104, Type::bits16, "heartbeat", "", "counts while the station lives; wraps",
           [](const Source& s) -> Number { return s.snapshot.heartbeat; }),
    number(105, Type::u16, "plc_heartbeat_age", "ms", "since the PLC's heartbeat last changed",
           [](const Source&) -> Number { return {}; }),
    number(106, Type::u32, "last_sequence", "", "newest result; 0: none since this boot",
           [](const Source& s) -> Number { return s.snapshot.last.sequence; }),
    number(108, Type::u32, "oldest_sequence", "", "oldest result that can still be read; 0: none",
           [](const Source& s) -> Number { return s.snapshot.last.sequence; }),
    number(110, Type::u16, "recipe", "", "number of the recipe in use",
           [](const Source&) -> Number { return {}; }),
    number(111, Type::bits32, "recipe_crc32", "", "CRC-32 of the recipe in use; 0: not known",
           [](const Source&) -> Number { return 0; }),
    number(
        113, Type::bits32, "faults_active", "", "faults that are present now",
        [](const Source& s) -> Number { return s.snapshot.faults_active; }, kFaultBits),
    number(
        115, Type::bits32, "faults_latched", "", "faults since the last reset",
        [](const Source& s) -> Number { return s.snapshot.faults_latched; }, kFaultBits),
    number(
        117, Type::u16, "first_fault", "", "the fault that came first since the last reset",
        [](const Source& s) -> Number { return s.snapshot.first_fault; }, kFirstFaults),
    number(118, Type::u32, "parts_on_line", "parts", "between part sensor and rejector",
           [](const Source& s) -> Number { return s.snapshot.parts_on_line; }),
};

constexpr Register kCounters[] = {
    number(142, Type::u32, "seen", "parts", "edges of the part sensor taken as parts",
           [](const Source& s) -> Number { return s.snapshot.counters.seen; }),
    number(144, Type::u32, "inspected", "parts", "parts with a frame that was judged",
           [](const Source& s) -> Number { return s.snapshot.counters.inspected; }),
    number(146, Type::u32, "pass", "parts", "verdict pass",
           [](const Source& s) -> Number { return s.snapshot.counters.pass; }),
    number(148, Type::u32, "reject", "parts", "verdict reject",
           [](const Source& s) -> Number { return s.snapshot.counters.reject; }),
    number(150, Type::u32, "unfit", "parts", "could not be judged; rejected to be safe",
           [](const Source& s) -> Number { return s.snapshot.counters.unfit; }),
    number(152, Type::u32, "missed", "parts", "passed the rejector without any decision",
           [](const Source& s) -> Number { return s.snapshot.counters.missed; }),
    number(154, Type::u32, "reject_commanded", "parts", "rejections asked of the ejector",
           [](const Source& s) -> Number { return s.snapshot.counters.reject_commanded; }),
    number(156, Type::u32, "reject_confirmed", "parts", "rejections that the ejector confirmed in time",
           [](const Source& s) -> Number { return s.snapshot.counters.reject_confirmed; }),
    number(158, Type::u32, "reject_failed", "parts",
           "rejections without confirmation: a bad part may have passed",
           [](const Source& s) -> Number { return s.snapshot.counters.reject_failed; }),
    number(160, Type::u32, "reject_late", "parts", "rejections confirmed after the part had passed",
           [](const Source& s) -> Number { return s.snapshot.counters.reject_late; }),
};

// One result in 24 registers, the same in LAST and in the ring. Its sequence stands at both ends: a reader
// that takes the slot in several requests sees that they differ when the slot was overwritten meanwhile.
constexpr std::uint16_t kResultWords = 24;
Number of_result(const Source& s, double value) {
    return s.result.sequence == 0 ? Number{} : Number{value};
}

template <std::uint16_t base>
constexpr std::array<Register, 16> kResult = {{
    number(base + 0, Type::u32, "sequence", "", "result number since this boot, from 1; 0: no result yet",
           [](const Source& s) -> Number { return s.result.sequence; }),
    number(base + 2, Type::u32, "part", "", "part number since arming, from 1",
           [](const Source& s) { return of_result(s, s.result.part); }),
    number(base + 4, Type::u32, "arrived_s", "s",
           "when the part reached the sensor: the station's monotonic clock",
           [](const Source& s) {
               return of_result(s, static_cast<double>(s.result.arrived_ns / 1'000'000'000));
           }),
    number(base + 6, Type::u32, "arrived_us", "us", "the same, microseconds within the second",
           [](const Source& s) {
               return of_result(s, static_cast<double>(s.result.arrived_ns / 1000 % 1'000'000));
           }),
    number(
        base + 8, Type::u16, "verdict", "", "everything but pass is rejected",
        [](const Source& s) { return of_result(s, static_cast<double>(s.result.verdict)); }, kVerdicts),
    number(
        base + 9, Type::u16, "reason", "", "below 16: judged; from 16: a way of not having a verdict",
        [](const Source& s) { return of_result(s, static_cast<double>(s.result.reason)); }, kReasons),
    number(base + 10, Type::u16, "defects", "", "defects found",
           [](const Source& s) { return of_result(s, s.result.defects); }),
    number(
        base + 11, Type::u32, "score", "", "worst value over its limit: above 1 is rejected",
        [](const Source& s) { return of_result(s, static_cast<double>(s.result.score)); }, {}, 0.001),
    number(base + 13, Type::u32, "latency", "us", "from the part sensor's edge to the verdict",
           [](const Source& s) { return of_result(s, s.result.latency_us); }),
    number(base + 15, Type::u32, "reject_latency", "us", "from the edge to the confirmed rejection",
           [](const Source& s) {
               return s.result.reject_latency_us == 0 ? Number{} : of_result(s, s.result.reject_latency_us);
           }),
    number(
        base + 17, Type::u16, "reject_state", "", "what became of the rejection",
        [](const Source& s) { return of_result(s, static_cast<double>(s.result.reject)); }, kRejectStates),
    number(base + 18, Type::u16, "position_m", "lenslets", "column of the worst defect's centre",
           [](const Source&) -> Number { return {}; }),
    number(base + 19, Type::u16, "position_n", "lenslets", "row of the worst defect's centre",
           [](const Source&) -> Number { return {}; }),
    number(base + 20, Type::u16, "recipe", "", "number of the recipe that judged",
           [](const Source&) -> Number { return {}; }),
    number(
        base + 21, Type::bits16, "flags", "", "how the result came about",
        [](const Source& s) -> Number {
            if (s.result.sequence == 0) return 0;
            const bool judged = static_cast<std::uint16_t>(s.result.reason) < 16;
            return (judged ? 1 : 0) | (s.result.verdict != PartVerdict::pass ? 2 : 0);
        },
        kResultFlags),
    number(base + 22, Type::u32, "sequence_again", "",
           "equal to `sequence`, or the slot was overwritten while it was read",
           [](const Source& s) -> Number { return s.result.sequence; }),
}};

constexpr Block kBlocks[] = {
    {BlockId::ident, "IDENT", 0, 98, "Who this is, and which map it speaks", kIdent},
    {BlockId::status, "STATUS", 100, 38, "What the station does now", kStatus},
    {BlockId::counters, "COUNTERS", 140, 58, "Totals since the start", kCounters},
    {BlockId::last, "LAST", 200, 98, "The newest result", kResult<202>},
    {BlockId::end, "END", 300, 0, "End of the chain", {}},
};

// -- what the table promises, checked where it is compiled
// -----------------------------------------------------

constexpr bool chain_is_contiguous() {
    std::uint16_t next = 0;
    for (const Block& block : kBlocks) {
        if (block.base != next) return false;
        next = static_cast<std::uint16_t>(block.base + block.size());
    }
    return kBlocks[std::size(kBlocks) - 1].id == BlockId::end;
}
constexpr bool rows_fit() {
    for (const Block& block : kBlocks) {
        std::uint16_t next = static_cast<std::uint16_t>(block.base + kBlockHeader);
        for (const Register& row : block.registers) {
            if (row.address < next || (row.number == nullptr) == (row.text == nullptr)) return false;
            next = static_cast<std::uint16_t>(row.address + row.words);
        }
        if (next > block.base + block.size()) return false;
        if (!block.registers.empty() && block.size() > kMaxRead) return false;
    }
    return true;
}
static_assert(chain_is_contiguous(), "each block's length leads to the next block");
static_assert(rows_fit(), "rows ascend, do not overlap, stay in their block; a block is one request");
static_assert(kResult<0>.back().address + kResult<0>.back().words == kResultWords);

}  // namespace

std::span<const Block> register_blocks() {
    return kBlocks;
}

}  // namespace hord::firmware
