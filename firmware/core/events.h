// The inputs of the core. Times inside an event are the device's; the time of the step is a parameter of Core::step().
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

enum class Device : std::uint8_t { part_sensor, strobe, sensor, rejector };  // in the order of their FaultBits
constexpr int kDevices = 4;
constexpr std::uint32_t fault_of(Device device) { return 1U << static_cast<unsigned>(device); }
constexpr std::uint32_t kDeviceFaults = kFaultPartSensor | kFaultStrobe | kFaultSensor | kFaultRejector;
static_assert(fault_of(Device::sensor) == kFaultSensor && kDeviceFaults == (1U << kDevices) - 1U);

// Identifies a frame buffer that the station (firmware/station/station.h) holds for the core.
using FrameHandle = std::uint32_t;

struct FrameArrived {
    FrameHandle frame = 0;
    hal::FrameInfo info;
};
struct Judged {
    std::uint32_t part = 0;
    bool failed = false;  // the inspection returned an error; the members below are not set
    algo::Verdict verdict = algo::Verdict::unfit;
    algo::Reason reason = algo::Reason::none;
    std::uint16_t defects = 0;
    float score = 0;
    std::uint16_t position_m = kNoNumber, position_n = kNoNumber;  // of the worst defect, lenslets
    std::uint16_t recipe = kNoNumber;                              // number of the recipe that judged
    bool bounded = false;                                          // algo::Inspection::bounded
};
struct DeviceUp {
    Device device{};
};
struct DeviceLost {
    Device device{};
};
// A device refused an action for this part.
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
// The PLC's heartbeat has stopped, or is back. The effect: CoreConfig::plc_policy.
struct PlcLost {};
struct PlcBack {};
// Unknown parts may be on the line: the process before this one ended with parts on it.
struct LineUnknown {};
// The bits of kOutsideFaults that are active now: faults that the core cannot detect and that change no verdict.
struct OutsideFaults {
    std::uint32_t active = 0;
};
// Core::next_wake() has been reached.
struct Tick {};

using Event = std::variant<Tick, Command, hal::PartEdge, hal::EncoderReading, FrameArrived, hal::StrobeReport, Judged,
                           hal::RejectReport, DeviceUp, DeviceLost, TriggerRefused, StrobeRefused, InspectRefused,
                           RejectRefused, PlcLost, PlcBack, LineUnknown, OutsideFaults>;

}  // namespace hord::firmware
