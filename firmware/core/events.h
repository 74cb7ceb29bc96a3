// What the core is told. Times inside an event are the device's; the time of the step is a parameter of its own.
#pragma once

#include <cstdint>
#include <variant>

#include "algo/verdict/verdict.h"
#include "drivers/hal/part_sensor.h"
#include "drivers/hal/rejector.h"
#include "drivers/hal/sensor.h"
#include "drivers/hal/strobe.h"
#include "firmware/core/commands.h"
#include "firmware/core/station_types.h"

namespace hord::firmware {

enum class Device : std::uint8_t { part_sensor, strobe, sensor, rejector };
constexpr int kDevices = 4;

// Names a frame that the shell holds on loan.
using FrameHandle = std::uint32_t;

struct FrameArrived {
    FrameHandle frame = 0;
    hal::FrameInfo info;
};
struct Judged {
    std::uint32_t part = 0;
    bool failed = false;  // the inspection returned an error; the rest is meaningless
    algo::Verdict verdict = algo::Verdict::unfit;
    algo::Reason reason = algo::Reason::none;
    std::uint16_t defects = 0;
    float score = 0;
    std::uint16_t position_m = kNoNumber, position_n = kNoNumber;  // of the worst defect, lenslets
    std::uint16_t recipe = kNoNumber;                              // number of the recipe that judged
};
struct DeviceUp {
    Device device{};
};
struct DeviceLost {
    Device device{};
};
// A device refused an action; `part` is the one it was for.
struct TriggerRefused {
    std::uint32_t part = 0;
};
struct StrobeRefused {
    std::uint32_t part = 0;
};
struct InspectRefused {
    std::uint32_t part = 0;
};
struct RejectRefused {
    std::uint32_t part = 0;
};
// The PLC's heartbeat has stopped, or is back: CoreConfig::plc_policy.
struct PlcLost {};
struct PlcBack {};
// Parts may be on the line that this core has never seen.
struct LineUnknown {};
// Troubles that the core cannot see itself and that change no verdict: kOutsideFaults. Those present now.
struct OutsideFaults {
    std::uint32_t active = 0;
};
// Time has passed: Core::next_wake() is due.
struct Tick {};

using Event = std::variant<Tick, Command, hal::PartEdge, hal::EncoderReading, FrameArrived, hal::StrobeReport, Judged,
                           hal::RejectReport, DeviceUp, DeviceLost, TriggerRefused, StrobeRefused, InspectRefused,
                           RejectRefused, PlcLost, PlcBack, LineUnknown, OutsideFaults>;

}  // namespace hord::firmware
