// The station's configuration: one TOML file, every key defaulted, deploy/hordd.toml documents them all.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "common/result.h"
#include "drivers/gardasoft/gardasoft_options.h"
#include "drivers/genicam/genicam_options.h"
#include "drivers/gpio/gpio_options.h"
#include "drivers/libcamera/libcamera_options.h"
#include "drivers/modbus/modbus_options.h"
#include "drivers/v4l2/v4l2_options.h"
#include "firmware/core/core_config.h"
#include "firmware/modbus/access.h"
#include "firmware/modbus/rtu_server.h"

namespace hord::firmware {

// [sensor] backend = "simulated" | "frames" | "v4l2" | "libcamera" | "genicam"
struct SimulatedSensor {
    std::filesystem::path scenes;  // folder of scene files, one a part; empty: the parts of hal_sim/cell/production.h
    bool operator==(const SimulatedSensor&) const = default;
};
struct FrameFolder {
    std::filesystem::path folder;     // every image in it is a frame, in the order of the names
    int bits = 0;                     // of frames without a note; 0: not named, as the files have them
    int width_px = 0, height_px = 0;  // that the frames must have; 0: any
    bool operator==(const FrameFolder&) const = default;
};
using SensorConfig = std::variant<SimulatedSensor, FrameFolder, drivers::V4l2SensorOptions,
                                  drivers::LibcameraSensorOptions, drivers::GenicamSensorOptions>;

// [rejector] backend = "simulated" | "modbus". The keys of a module, except its address, also apply
// to the module of the simulated cell (hordctl run --simulate).
struct SimulatedRejector {
    drivers::ModbusRejectorOptions module;
    bool operator==(const SimulatedRejector&) const = default;
};
using RejectorConfig = std::variant<SimulatedRejector, drivers::ModbusRejectorOptions>;

// [strobe] backend = "simulated" | "gpio" | "gardasoft" | "camera"
struct StrobeController {
    drivers::GardasoftStrobeOptions gardasoft;
    std::vector<drivers::GpioLine> triggers;  // one a channel, to the controller's inputs; empty: triggered by command
    bool operator==(const StrobeController&) const = default;
};
struct StrobeConfig {
    int channels = 1;
    drivers::LightLimits limits;                   // of every channel that has none of its own
    std::vector<drivers::GpioStrobeChannel> gpio;  // [[strobe.channel]] of "gpio"; else empty
    std::optional<StrobeController> controller;    // of "gardasoft"
    std::string camera_line;                       // of "camera": its output; SensorConfig has it, too
    [[nodiscard]] bool simulated() const { return gpio.empty() && !controller && camera_line.empty(); }
    bool operator==(const StrobeConfig&) const = default;
};

// [part_sensor] backend = "simulated" | "gpio" | "camera"
struct SimulatedPartSensor {
    bool operator==(const SimulatedPartSensor&) const = default;
};
struct CameraInput {
    std::string line;  // SensorConfig has it, too
    bool active_low = false;
    bool operator==(const CameraInput&) const = default;
};
using PartSensorConfig = std::variant<SimulatedPartSensor, drivers::GpioPartSensorOptions, CameraInput>;

// [modbus]: the register server that the PLC reads and writes.
struct TcpServer {
    std::string host = "127.0.0.1";
    std::uint16_t port = 1502;         // 0: any free port
    std::uint16_t read_only_port = 0;  // a second, read-only port; 0: none
    std::size_t max_connections = 32;
    std::vector<modbus::AccessRule> access = default_access();  // who may connect, and who may write

    static std::vector<modbus::AccessRule> default_access();  // all may read, this machine may write
};

// [serial]: the same registers on a serial line (Modbus RTU).
using SerialLine = std::optional<modbus::SerialOptions>;

// [plc]: its heartbeat. The policy is in CoreConfig::plc_policy.
struct PlcConfig {
    Duration timeout = milliseconds(2000);
};

struct InspectionConfig {
    int bins_i = 9, bins_j = 9;     // bins of a macro-pixel
    std::filesystem::path grid;     // calibration file for decoding raw frames; empty: frames are macro-pixels
    std::filesystem::path recipe;   // empty: the defaults of algo/recipe/recipe.h
    std::filesystem::path recipes;  // folder of the recipes that can be selected by number; empty: none
    int threads = 1;                // parts inspected at the same time
    int queue = 8;                  // frames that can wait for a thread
    Duration budget{};              // timing.inspect_budget_ms: algo::InspectionLimits::time_ns; 0: only that of work
};

// [optics]: when ageing light and optics become a fault (docs/service.md). Verdicts do not depend on it.
struct OpticsConfig {
    int window_parts = 100;         // window of the trends and of the dust detection
    double least_light = 0.8;       // share of the first parts' light
    double most_dark_drift_dn = 0;  // 0: one DN at 8 bits, the same share of the full scale at others
    double most_uneven = 0.2;       // change of a region's share of the light

    bool operator==(const OpticsConfig&) const = default;
};

// [store]: the station's records (docs/store.md). Sizes in megabytes of 10^6 bytes.
struct StoreConfig {
    bool enabled = true;
    std::filesystem::path folder;             // empty: "store" in the state folder; without either nothing is stored
    int keep_days = 400;                      // results and commands; 0: no limit
    int keep_mb = 4000;                       // the same; 0: no limit
    int frames_mb = 4000;                     // frames of rejects and samples; 0: none are kept
    int free_mb = 1000;                       // frames leave this much of the disk free
    int frames_before = 2, frames_after = 2;  // frames of neighbours of a part that did not pass
    std::uint32_t sample_every = 1000;        // parts; 0: no samples
    int frame_buffers = 24;                   // in memory, waiting for the disk

    bool operator==(const StoreConfig&) const = default;
};

struct Config {
    std::string name = "hord";
    CoreConfig core;  // [line], [timing] and the rejector's times
    SensorConfig sensor;
    StrobeConfig strobe;
    PartSensorConfig part_sensor;
    RejectorConfig rejector;
    TcpServer modbus;
    SerialLine serial;
    PlcConfig plc;
    std::filesystem::path
        state_folder;       // files kept over restarts; empty: none are. Not a key: the service's $STATE_DIRECTORY
    bool autostart = true;  // arms and starts when all devices are up; false: the PLC or hordctl commands it
    InspectionConfig inspection;
    OpticsConfig optics;
    StoreConfig store;
    std::filesystem::path file;  // the configuration's file; empty: none
};

// Whether [sensor], [strobe], [part_sensor] and [rejector] must each name their backend. A file that lacks one, or that
// lost its end, would otherwise mean a simulated device beside real ones. optional: `hordctl run --simulate`.
enum class NamedBackends : bool { optional, required };

// Fail with invalid_argument: all problems of the file at once, one a line with line number and cure. Relative paths in
// the file start at its folder.
Result<Config> load_config(const std::filesystem::path& file, NamedBackends backends = NamedBackends::required);
Result<Config> parse_config(std::string_view text, std::string_view name, const std::filesystem::path& folder,
                            NamedBackends backends = NamedBackends::required);

// The folder of the store; empty: no store is configured.
std::filesystem::path store_folder(const Config& config);

// What the configuration allows and is hardly meant: a simulated device beside a real one that it does not work with
// (for trials of single devices), a name that registers cut, a file that may have lost its end. Each with its cure.
std::vector<Error> notes(const Config& config);

}  // namespace hord::firmware
