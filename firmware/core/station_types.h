// What the station reports: its state, the results of parts, counters. Filled by the core; read by registers, store,
// `hordctl status` and the tests.
#pragma once

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <string_view>

#include "algo/verdict/verdict.h"
#include "firmware/core/faults.h"

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

enum class PartVerdict : std::uint16_t { pass = 1, reject = 2, unfit = 3 };
constexpr std::string_view name_of(PartVerdict verdict) {
    switch (verdict) {
        case PartVerdict::pass: return "pass";
        case PartVerdict::reject: return "reject";
        case PartVerdict::unfit: return "unfit";
    }
    return "unknown";
}

// Why a part has its verdict: below 16 the inspection's reason (algo/verdict/verdict.h), from 16 on why it was not
// judged; such a part is rejected.
enum class PartReason : std::uint16_t {
    none = static_cast<std::uint16_t>(algo::Reason::none),
    neighbours_disagree = static_cast<std::uint16_t>(algo::Reason::neighbours_disagree),
    deflection_gradient = static_cast<std::uint16_t>(algo::Reason::deflection_gradient),
    absorption = static_cast<std::uint16_t>(algo::Reason::absorption),
    too_dark = static_cast<std::uint16_t>(algo::Reason::too_dark),
    saturated = static_cast<std::uint16_t>(algo::Reason::saturated),
    nothing_to_see = static_cast<std::uint16_t>(algo::Reason::nothing_to_see),
    not_registered = static_cast<std::uint16_t>(algo::Reason::not_registered),
    no_part = static_cast<std::uint16_t>(algo::Reason::no_part),
    unexpected_light = static_cast<std::uint16_t>(algo::Reason::unexpected_light),
    unexpected_geometry = static_cast<std::uint16_t>(algo::Reason::unexpected_geometry),
    missing_material = static_cast<std::uint16_t>(algo::Reason::missing_material),

    verdict_late = 16,         // no verdict by the deadline
    frame_lost = 17,           // no frame came
    frame_stale = 18,          // the frame was not exposed within the window of this part's exposure
    frame_duplicate = 19,      // the same frame came again, or two frames in this part's window
    frame_short = 20,          // fewer bytes than a frame
    frame_corrupt = 21,        // flagged by the device
    strobe_failed = 22,        // the light did not come, or came at the wrong time
    parts_too_close = 23,      // this part came before the one ahead was exposed
    station_not_running = 24,  // the part came while the station was not executing
    device_lost = 25,          // a device failed while the part was on the line
    line_full = 26,            // more parts between part sensor and ejector than the line can hold
    edge_lost = 27,            // the part sensor missed an edge: it is uncertain which part this is
    inspector_failed = 28,     // the inspection returned an error
    plc_lost = 29,             // the PLC's heartbeat stopped, and the policy is reject_all
};
constexpr bool is_judged(PartReason reason) { return static_cast<std::uint16_t>(reason) < 16; }
constexpr std::string_view name_of(PartReason reason) {
    constexpr std::string_view names[] = {// from 16 on
                                          "verdict-late",        "frame-lost",    "frame-stale",   "frame-duplicate",
                                          "frame-short",         "frame-corrupt", "strobe-failed", "parts-too-close",
                                          "station-not-running", "device-lost",   "line-full",     "edge-lost",
                                          "inspector-failed",    "plc-lost"};
    if (reason <= PartReason::missing_material) return algo::name_of(static_cast<algo::Reason>(reason));
    const auto row = static_cast<std::size_t>(reason) - 16;
    return !is_judged(reason) && row < std::size(names) ? names[row] : "unknown";
}
static_assert(name_of(PartReason::plc_lost) == "plc-lost" && name_of(PartReason{30}) == "unknown");

// What the station does while the PLC's heartbeat is missing.
enum class PlcPolicy : std::uint16_t {
    none = 0,
    stop = 1,        // inspects no new part and refuses to start; Ready when the line is empty
    reject_all = 2,  // rejects every part that has no verdict yet
};
constexpr std::string_view name_of(PlcPolicy policy) {
    switch (policy) {
        case PlcPolicy::none: return "none";
        case PlcPolicy::stop: return "stop";
        case PlcPolicy::reject_all: return "reject_all";
    }
    return "unknown";
}

// How the rejection of a part ended. A part that ends failed or late may have passed the ejector: it raises line stop
// and the fault reject-unconfirmed, unless a reset has ended its tracking.
enum class RejectState : std::uint16_t {
    not_needed = 0,  // it passed
    commanded = 1,   // the rejector's report is awaited; no recorded result has this value
    confirmed = 2,   // acknowledged in time
    failed = 3,  // never acknowledged: no rejector, refused, reported as failed, no report, or the part's place is lost
    late = 4,    // commanded or acknowledged too late for this part, or, with an encoder, the part was elsewhere
};
constexpr std::string_view name_of(RejectState state) {
    switch (state) {
        case RejectState::not_needed: return "not-needed";
        case RejectState::commanded: return "commanded";
        case RejectState::confirmed: return "confirmed";
        case RejectState::failed: return "failed";
        case RejectState::late: return "late";
    }
    return "unknown";
}

struct Counters {
    std::uint32_t seen = 0, inspected = 0, pass = 0, reject = 0, unfit = 0, missed = 0;
    // Rejections that were due, and how they ended (RejectState); the rest is under way. Without confirmation: failed
    // and late together.
    std::uint32_t reject_commanded = 0, reject_confirmed = 0, reject_failed = 0, reject_late = 0;
    bool operator==(const Counters&) const = default;
};

// A defect's position or a recipe's number that does not exist; the registers show "not available".
constexpr std::uint16_t kNoNumber = 0xFFFF;

struct PartResult {
    std::uint32_t sequence = 0;   // of results, from 1; 0: no result yet
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
    bool bounded = false;  // score and defects may be upper bounds (algo::Inspection::bounded)
};

struct Snapshot {
    State state = State::preoperational;
    std::int64_t taken_ns = 0;  // station time of the core's last step
    bool line_stop = false;     // a rejection ended failed or late, or parts on the line are not tracked; until a reset
    LineStop line_stop_why = {};
    bool run_permit = false;
    std::uint32_t faults_active = 0, faults_latched = 0;
    std::uint16_t first_fault = 0;  // bit number + 1; 0: none
    std::uint16_t station_heartbeat = 0;
    std::uint32_t parts_on_line = 0;
    Counters counters;
    PartResult last;
};

// Answer to an acknowledgement by the PLC: it is recorded only when a loss of power no longer loses the results.
enum class AckStatus : std::uint8_t {
    recorded,
    not_yet,  // not recorded yet: the PLC repeats its write
    failed,   // they cannot be stored now
};

}  // namespace hord::firmware
