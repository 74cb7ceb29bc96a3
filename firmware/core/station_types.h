// What the station says of itself: filled by the core's shell, read by the registers, `status` and the tests.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace hord::firmware {

// OPC 40100-1 (machine vision) state numbers.
enum class State : std::uint16_t {
    preoperational = 1,
    halted = 2,
    error = 3,
    initialized = 5,
    ready = 6,
    single_execution = 7,
    continuous_execution = 8,
};
constexpr std::string_view name_of(State s) {
    switch (s) {
        case State::preoperational: return "Preoperational";
        case State::halted: return "Halted";
        case State::error: return "Error";
        case State::initialized: return "Initialized";
        case State::ready: return "Ready";
        case State::single_execution: return "SingleExecution";
        case State::continuous_execution: return "ContinuousExecution";
    }
    return "unknown";
}

// What was decided for a part and why: the inspection's own reasons, and every way of not having one.
enum class PartVerdict : std::uint16_t { pass = 1, reject = 2, unfit = 3 };
enum class PartReason : std::uint16_t {
    none = 0,
    // judged
    deflection = 1,
    slope = 2,
    absorption = 3,
    too_dark = 4,
    saturated = 5,
    nothing_to_see = 6,
    not_registered = 7,
    // not judged: fail-safe
    verdict_late = 16,         // no verdict by the deadline
    frame_lost = 17,           // no frame came
    frame_stale = 18,          // the frame was exposed before this part's strobe
    frame_duplicate = 19,      // the device delivered the same frame again
    frame_short = 20,          // fewer bytes than a frame
    frame_corrupt = 21,        // flagged by the device
    strobe_failed = 22,        // the light did not come, or came at the wrong time
    parts_too_close = 23,      // this part came before the one ahead was exposed
    station_not_running = 24,  // the part came while the station was not executing
    device_lost = 25,          // a device failed while the part was under way
    line_full = 26,            // more parts between sensor and rejector than the line can hold
    edge_lost = 27,            // the part sensor missed an edge: identity is uncertain
    inspector_failed = 28,     // the inspection returned an error
    plc_lost = 29,             // the PLC's heartbeat stopped, and the policy is to reject every part
};
std::string_view name_of(PartReason reason);

// What the station does when the PLC's heartbeat stops.
enum class PlcPolicy : std::uint16_t {
    none = 0,
    stop = 1,  // inspects no new part and starts no more until the heartbeat is back; Ready when the line is empty
    reject_all = 2,  // every part without a verdict is rejected until the heartbeat is back
};

enum class RejectState : std::uint16_t { not_needed = 0, commanded = 1, confirmed = 2, failed = 3, late = 4 };

// Faults are bits; a person reads their names and cures in firmware/core/faults.h.
enum FaultBit : std::uint32_t {
    kFaultPartSensor = 1U << 0,
    kFaultStrobe = 1U << 1,
    kFaultSensor = 1U << 2,
    kFaultRejector = 1U << 3,
    kFaultRejectUnconfirmed = 1U << 4,  // line stop: a bad part may have passed the ejector
    kFaultInspector = 1U << 5,
    kFaultOverrun = 1U << 6,  // verdicts come later than the line allows
    kFaultConfiguration = 1U << 7,
    kFaultLightLevel = 1U << 8,
    kFaultPlc = 1U << 9,         // the PLC's heartbeat stopped, and the policy is not "none"
    kFaultStore = 1U << 10,      // results cannot be stored now; they wait in memory
    kFaultPictures = 1U << 11,   // frames that should have been kept were dropped
    kFaultGridDrift = 1U << 12,  // the lenslet grid has moved; verdicts do not suffer yet
    kFaultLightFading =
        1U << 13,  // parts have less light than they had; they are judged as before, as with the next three
    kFaultDarkDrift = 1U << 14,    // the sensor's dark level has changed
    kFaultLightUneven = 1U << 15,  // a region of the field has another share of the light than it had
    kFaultDust = 1U << 16,         // the same places of the sensor respond in part after part
};

// Troubles that the core cannot see itself and that change no verdict.
inline constexpr std::uint32_t kOpticsFaults = kFaultLightFading | kFaultDarkDrift | kFaultLightUneven | kFaultDust;
inline constexpr std::uint32_t kOutsideFaults = kFaultStore | kFaultPictures | kFaultGridDrift | kOpticsFaults;

struct Counters {
    std::uint32_t seen = 0, inspected = 0, pass = 0, reject = 0, unfit = 0, missed = 0;
    std::uint32_t reject_commanded = 0, reject_confirmed = 0, reject_failed = 0, reject_late = 0;
    bool operator==(const Counters&) const = default;
};

// No defect, no recipe: the registers show "not available".
constexpr std::uint16_t kNoNumber = 0xFFFF;

struct PartResult {
    std::uint32_t sequence = 0;   // result number, from 1; 0: no result yet
    std::uint32_t part = 0;       // part number since the station started, from 1
    std::int64_t arrived_ns = 0;  // station time of the edge
    PartVerdict verdict = PartVerdict::unfit;
    PartReason reason = PartReason::none;
    std::uint16_t defects = 0;
    float score = 0;                      // worst value over its limit
    std::uint32_t latency_us = 0;         // edge to verdict
    std::uint32_t reject_latency_us = 0;  // edge to confirmed reject; 0 when not rejected
    RejectState reject = RejectState::not_needed;
    std::uint16_t position_m = kNoNumber, position_n = kNoNumber;  // of the worst defect's centre, lenslets
    std::uint16_t recipe = kNoNumber;                              // number of the recipe that judged
};

struct Snapshot {
    State state = State::preoperational;
    bool line_stop = false;  // raised when a rejection cannot be confirmed
    bool run_permit = false;
    std::uint32_t faults_active = 0, faults_latched = 0;
    std::uint16_t first_fault = 0;  // bit number + 1; 0: none
    std::uint16_t heartbeat = 0;
    std::uint32_t parts_on_line = 0;
    Counters counters;
    PartResult last;
};

}  // namespace hord::firmware
