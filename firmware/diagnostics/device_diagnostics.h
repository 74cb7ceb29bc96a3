// Tests the devices of a cell, one by one, with a cure for each that does not work. For the set-up of a cell.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "algo/frame/grid_decoder.h"
#include "algo/recipe/recipe.h"
#include "drivers/hal/event_loop.h"
#include "drivers/hal/part_sensor.h"
#include "drivers/hal/rejector.h"
#include "drivers/hal/sensor.h"
#include "drivers/hal/strobe.h"
#include "firmware/core/core_config.h"

namespace hord::firmware {

// An opened device, or the error of opening it.
template <class Device>
struct DeviceUnderTest {
    Result<Device*> device = nullptr;  // null: simulated, not tested
    std::string name;                  // as the configuration names it: "gpiochip0 line 6", "/dev/video0"
};

struct CellUnderTest {
    DeviceUnderTest<hal::PartSensor> part_sensor;
    DeviceUnderTest<hal::Strobe> strobe;
    DeviceUnderTest<hal::Sensor> sensor;
    DeviceUnderTest<hal::Rejector> rejector;
    // Reads the identity and outputs of the rejector's module over its own connection; moves nothing. May block. Empty:
    // the rejector is not a module.
    std::function<Result<std::string>()> ask_module;
    bool encoder = false;        // the part sensor has one
    bool camera_lights = false;  // no light without a frame, no frame without light
    bool camera_hears = false;   // the part sensor is heard while the sensor streams

    CoreConfig core;
    algo::Recipe recipe;
    int bins_i = 9, bins_j = 9;
    std::optional<algo::GridDecoder> decoder;  // none: frames are macro-pixels
};

struct CheckRow {
    enum class Result : std::uint8_t { good, bad, skipped };
    std::string what;
    Result result = Result::good;
    std::string found, cure;
};

struct DeviceDiagnosticsOptions {
    bool actuate = false;  // the ejector is pulsed once
    // Runs the loop until `done` returns true, for at most `patience`. Returns whether it was done.
    std::function<bool(const std::function<bool()>& done, hal::Duration patience)> wait;
    std::function<void(const CheckRow&)> row;  // called for each row when it is known; may be empty
};

// Loop thread, outside of its callbacks. Pulses each light once, takes one frame with light and one without, and asks
// the rejector's module; nothing else moves unless `actuate`. All devices are stopped again when it returns.
std::vector<CheckRow> check_cell(hal::EventLoop& loop, CellUnderTest& cell, const DeviceDiagnosticsOptions& options);

// The rows as a table, each bad one with its cure.
std::string table_of(const std::vector<CheckRow>& rows);

}  // namespace hord::firmware
