// The core's parameters: when to expose, how long to wait, when and for how long to eject.
//
// All delays count from the part sensor's edge. firmware/config/config.h reads the parameters from the configuration
// file and checks problems() before a Core is created.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/hal/clock.h"
#include "firmware/core/station_types.h"

namespace hord::firmware {

using hal::Duration;
using hal::TimePoint;

constexpr Duration microseconds(std::int64_t n) { return Duration(n * 1000); }
constexpr Duration milliseconds(std::int64_t n) { return Duration(n * 1'000'000); }

// Parts a Core has memory for. Parts above CoreConfig::max_parts are not inspected, only tracked to the rejector.
constexpr std::uint32_t kLineCapacity = 256;

// Line stop stays for this time at least. A reset that comes sooner was sent before anyone could have seen the line
// stop, for example while the process was held up: it is refused. Only time in which the process ran counts: from one
// step to the next at most kMaxTurn.
constexpr Duration kMinLineStop = milliseconds(200);
constexpr Duration kMaxTurn = milliseconds(20);

struct CoreConfig {
    // Distance from part sensor to ejector: a time on a conveyor of constant speed, encoder counts on one that may
    // slow, stop and restart.
    bool by_encoder = false;
    Duration transport = milliseconds(400);        // edge to the part at the ejector, without encoder
    std::int64_t transport_counts = 4000;          // the same in counts, with encoder
    Duration encoder_timeout = milliseconds(100);  // no reading for longer with parts on the line: position is lost
    std::uint32_t max_parts = 64;                  // inspected parts between sensor and ejector, 1..kLineCapacity
    Duration min_gap = milliseconds(20);           // edges closer than this: parts_too_close
    std::int64_t min_gap_counts = 200;             // the same in counts, with encoder, in addition

    // Longest time a part covers the part sensor, or counts with an encoder; longer: parts touch; 0: not checked.
    Duration max_part = Duration::zero();
    std::int64_t max_part_counts = 0;

    // Exposure and light. Several parts may be between part sensor and camera.
    Duration exposure_delay = milliseconds(5);  // edge to the start of the exposure, without encoder
    std::int64_t exposure_counts = 50;          // the same in counts, with encoder
    Duration trigger_lead = milliseconds(5);    // the requests go out so long before the exposure, or at the edge
    Duration exposure = microseconds(500);
    Duration strobe_delay = microseconds(100);  // start of the exposure to the start of the light
    Duration strobe = microseconds(200);
    std::uint32_t strobe_channels = 1;           // bit set of collimators
    Duration strobe_window = microseconds(100);  // tolerance of the light's start and width
    Duration frame_window = milliseconds(2);     // tolerance of a frame's exposure time stamp
    Duration frame_timeout = milliseconds(100);  // longest wait for frame and strobe report after the exposure's end
    std::size_t frame_bytes = 0;                 // a frame with fewer bytes is short

    // Rejection. The pulse begins `reject_early` before the part is at the ejector; the command goes out `reject_lead`
    // before the pulse: that is the verdict's deadline.
    Duration reject_lead = milliseconds(20);
    Duration reject_early = milliseconds(5);
    Duration reject_pulse = milliseconds(15);
    Duration confirm_timeout = milliseconds(100);  // longest wait for the report after the pulse's end

    // So many parts in a row without a judgement, by faults of the station, lead to Error; 0: never.
    std::uint32_t max_failures_in_a_row = 5;
    Duration station_heartbeat = milliseconds(500);
    PlcPolicy plc_policy = PlcPolicy::none;  // effect of PlcLost

    bool operator==(const CoreConfig&) const = default;
};

// Contradictions in the numbers, one line each, under the configuration's names. Empty: the numbers can be used.
std::vector<std::string> problems(const CoreConfig& config);

}  // namespace hord::firmware
