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
#include "drivers/hal/module_map.h"
#include "firmware/core/core_config.h"
#include "firmware/modbus/access.h"
#include "firmware/modbus/rtu_server.h"

namespace hord::firmware {

// A line of the kernel's GPIO character device.
struct GpioLineName {
    enum class Bias : std::uint8_t { as_is, disabled, pull_up, pull_down };
    std::string chip;  // label, name or path
    std::string line;  // name, or offset in digits
    bool active_low = false;
    Bias bias = Bias::as_is;  // of an input
    bool operator==(const GpioLineName&) const = default;
};

// [sensor] backend = "simulated" | "frames" | "v4l2" | "libcamera"
struct SimulatedSensor {
    bool operator==(const SimulatedSensor&) const = default;
};
struct RecordedFrames {
    std::filesystem::path folder;  // every image in it, in the order of their names
    bool operator==(const RecordedFrames&) const = default;
};
struct VideoSensor {
    std::string device = "/dev/video0";
    int width_px = 0, height_px = 0;  // 0: as the device is set
    int bits = 8;                     // 8, 10, 12 or 16
    int buffers = 4;
    std::vector<std::pair<std::string, std::int64_t>> controls;  // by name
    bool operator==(const VideoSensor&) const = default;
};
struct CameraSensor {
    std::string camera;               // libcamera's id; empty: the only one there is
    int width_px = 0, height_px = 0;  // 0: as the camera proposes
    int bits = 8;                     // 8, 10, 12 or 16
    int buffers = 4;
    bool green = false;                                          // of colour frames, where there are no grey ones
    std::vector<std::pair<std::string, std::int64_t>> controls;  // by libcamera's names
    bool operator==(const CameraSensor&) const = default;
};
using SensorConfig = std::variant<SimulatedSensor, RecordedFrames, VideoSensor, CameraSensor>;

// [rejector] backend = "simulated" | "modbus"
struct ModbusRejector {
    std::string host = "127.0.0.1";
    std::uint16_t port = 502;
    std::string device;  // a serial line instead (Modbus RTU); empty: TCP
    int baud = 19200;
    char parity = 'E';  // 'N', 'E', 'O'
    bool rs485 = true;  // the kernel switches the transmitter
    std::uint8_t unit = 1;
    hal::ModuleMap map;                 // of the profile, and what the file says instead
    std::uint16_t reject_coil = 0;      // address of the ejector's coil
    std::uint16_t run_permit_coil = 1;  // address of the run permit's coil
    bool energise_to_pass = false;      // the coil is 1 while good parts pass: a module that lost its link rejects
    Duration module_pulse{};            // the module times the pulse, and it is so long; zero: the station does
    int confirm_input = -1;             // discrete input that sees an ejected part arrive; -1: none
    bool confirm_active_low = false;
    Duration confirm_within = milliseconds(50);  // after the pulse
    Duration watchdog{};                         // the module's, set and kept alive by the station; zero: left as it is
    Duration response_timeout = milliseconds(30);
    bool operator==(const ModbusRejector&) const = default;
};
// What the table says of a module holds for the simulated cell's, too (hordctl run --simulate), but for its address.
struct SimulatedRejector {
    ModbusRejector module;
    bool operator==(const SimulatedRejector&) const = default;
};
using RejectorConfig = std::variant<SimulatedRejector, ModbusRejector>;

// [strobe] backend = "simulated" | "gpio"
struct StrobeChannel {
    GpioLineName line;
    Duration max_on, min_rest;
    double max_duty = 0;
    bool operator==(const StrobeChannel&) const = default;
};
struct StrobeConfig {
    int channels = 1;
    Duration max_on = milliseconds(2);  // limits of every channel that has none of its own
    Duration min_rest = milliseconds(5);
    double max_duty = 0.2;
    std::vector<StrobeChannel> gpio;  // [[strobe.channel]]; empty: simulated
    bool operator==(const StrobeConfig&) const = default;
};

// [part_sensor] backend = "simulated" | "gpio"
struct SimulatedPartSensor {
    bool operator==(const SimulatedPartSensor&) const = default;
};
struct GpioPartSensorLine {
    GpioLineName line;
    Duration debounce = microseconds(200);
    std::optional<GpioLineName> encoder;
    Duration encoder_every = milliseconds(5);
    bool operator==(const GpioPartSensorLine&) const = default;
};
using PartSensorConfig = std::variant<SimulatedPartSensor, GpioPartSensorLine>;

// [modbus]: the register server that the PLC reads and writes.
struct TcpServer {
    std::string host = "127.0.0.1";
    std::uint16_t port = 1502;         // 0: any free port
    std::uint16_t read_only_port = 0;  // a second one, where nobody may write; 0: none
    std::size_t max_connections = 32;
    std::vector<modbus::AccessRule> access = default_access();  // who may connect, and who of these may write

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
    std::filesystem::path grid;     // calibration file that raw frames are decoded with; empty: frames are macro-pixels
    std::filesystem::path recipe;   // empty: the defaults of algo/recipe/recipe.h
    std::filesystem::path recipes;  // folder of those that can be switched to by number; empty: none
    int threads = 1;                // parts inspected at the same time
    int queue = 8;                  // frames that may wait for a thread
};

// [optics]: from where on ageing light and optics are a fault (docs/service.md). No verdict depends on it.
struct OpticsConfig {
    int window_parts = 100;         // that trends and dust are looked at over
    double least_light = 0.8;       // of what parts had
    double most_dark_drift_dn = 0;  // 0: one DN at 8 bits, the same share of the full scale at others
    double most_uneven = 0.2;       // change of a region's share of the light

    bool operator==(const OpticsConfig&) const = default;
};

// [store]: what outlives a run (docs/store.md). Sizes in megabytes of 10^6 bytes.
struct StoreConfig {
    bool enabled = true;
    std::filesystem::path folder;  // empty: "store" in the state folder; nothing is kept where there is none either
    int keep_days = 400;           // results and commands; 0: no limit
    int keep_mb = 4000;            // the same; 0: no limit
    int frames_mb = 4000;          // frames of rejects and samples; 0: none are kept
    int free_mb = 1000;            // frames leave so much of the disk free
    int frames_before = 2, frames_after = 2;  // parts around one that did not pass
    std::uint32_t sample_every = 1000;        // parts; 0: no samples
    int frame_buffers = 24;                   // frames that may wait for the disk, in memory

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
        state_folder;       // what outlives a run; empty: nothing does. Not a key: the service's $STATE_DIRECTORY
    bool autostart = true;  // arms and starts by itself as soon as every device is up; false: somebody commands it
    InspectionConfig inspection;
    OpticsConfig optics;
    StoreConfig store;
    std::filesystem::path file;  // that it was read from; empty: none
};

// Fails with invalid_argument; every problem of the file at once, a line each with line number and cure.
// Relative paths inside are taken from the file's folder.
Result<Config> load_config(const std::filesystem::path& file);
Result<Config> parse_config(std::string_view text, std::string_view name, const std::filesystem::path& folder);

}  // namespace hord::firmware
