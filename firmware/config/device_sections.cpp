#include "firmware/config/device_sections.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

#include <arpa/inet.h>
#include <strings.h>

#include "drivers/hal/camera_sensor.h"
#include "firmware/config/module_profiles.h"

namespace hord::firmware {

using common::TomlTable;

void host(TomlTable& table, std::string_view key, std::string& value) {
    table.text(key, value);
    constexpr std::string_view kLetters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-_";
    const std::string cure = "give a host name or an address, as \"192.168.1.20\"; the port has a key of its own";
    if (value.empty()) return table.problem(key, "is empty", "give a host name or an address");
    in6_addr six{};
    in_addr four{};
    if (::inet_pton(AF_INET6, value.substr(0, value.find('%')).c_str(), &six) == 1) return;
    if (value.find_first_not_of("0123456789.") == std::string::npos) {
        if (::inet_pton(AF_INET, value.c_str(), &four) != 1)
            table.problem(key, "is no IPv4 address", "write four numbers from 0 to 255, as \"192.168.1.20\"");
    } else if (value.find_first_not_of(kLetters) != std::string::npos) {
        table.problem(key, "\"" + value + "\" is neither a host name nor an address", cure);
    }
}

void baud(TomlTable& table, int& value) {
    constexpr std::array kRates{1200, 2400, 4800, 9600, 19'200, 38'400, 57'600, 115'200, 230'400, 460'800, 921'600};
    table.integer("baud", value, 1200, 921'600);
    if (std::ranges::find(kRates, value) == kRates.end())
        table.problem("baud", "is no rate of a serial line",
                      "use 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800 or 921600");
}

namespace {

// What would be set and have no effect. A value that is the default is no setting: a file may hold every key.
void refuse(TomlTable& table, bool set, std::string_view key, std::string_view cure,
            std::string_view what = "has no effect with this backend") {
    if (set) table.problem(key, what, cure);
}

// Reads a GPIO line from the keys "chip", "line", "active_low" and, for an input, "bias" of `table`.
drivers::GpioLine gpio_line(TomlTable& table, bool input) {
    drivers::GpioLine line;
    table.text("chip", line.chip);
    table.text("line", line.line);
    table.boolean("active_low", line.active_low);
    if (input) table.choice("bias", {"as-is", "disabled", "pull-up", "pull-down"}, line.bias);
    return line;
}

void check_gpio_line(TomlTable& table, const drivers::GpioLine& line) {
    if (line.chip.empty())
        table.problem("chip", "is missing", "name the GPIO chip by its label, as gpiodetect prints it");
    if (line.line.empty())
        table.problem("line", "is missing", "name the line, or give its offset as \"6\"; see gpioinfo");
}

}  // namespace

namespace {

void refuse_other_cameras_keys(TomlTable& sensor, int backend, const drivers::V4l2SensorOptions& video,
                               const drivers::GenicamSensorOptions& genicam, bool green) {
    constexpr int kV4l2 = 2, kLibcamera = 3, kGenicam = 4;
    const std::string& camera = genicam.camera;
    const auto refuse = [&](bool set, const char* key, const char* cure) { firmware::refuse(sensor, set, key, cure); };
    const bool set_by_controls = backend == kV4l2 || backend == kLibcamera;
    refuse(!set_by_controls && !video.controls.empty(), "control",
           backend == kGenicam ? "set a GenICam camera's features, in [[sensor.feature]]"
                               : "take it out: only cameras of v4l2 and libcamera have controls");
    refuse(backend != kGenicam && !genicam.features.empty(), "feature",
           set_by_controls ? "set this camera's controls, in [[sensor.control]]; only GenICam cameras have features"
                           : "take it out, or set sensor.backend to \"genicam\"");
    if (backend < kV4l2) return;
    if (backend != kGenicam) {
        const drivers::GenicamSensorOptions unset;
        const char* const cure = "take it out: only GenICam cameras have it";
        refuse(genicam.offset_x_px != unset.offset_x_px, "offset_x_px", cure);
        refuse(genicam.offset_y_px != unset.offset_y_px, "offset_y_px", cure);
        refuse(genicam.pixel_format != unset.pixel_format, "pixel_format",
               "take it out: sensor.bits chooses the format");
        refuse(genicam.trigger != unset.trigger, "trigger",
               "take it out: the strobe's wire triggers this camera, or it runs free");
        refuse(genicam.trigger_source != unset.trigger_source, "trigger_source", cure);
        refuse(genicam.packet_bytes != unset.packet_bytes, "packet_bytes", cure);
        refuse(genicam.socket_buffer_bytes != unset.socket_buffer_bytes, "socket_buffer_bytes", cure);
    }
    refuse(backend != kLibcamera && green, "green", "take it out: only colour frames of libcamera need it");
    refuse(backend != kV4l2 && video.device != drivers::V4l2SensorOptions{}.device, "device",
           "take it out, and name the camera in sensor.camera");
    refuse(backend == kV4l2 && !camera.empty(), "camera", "take it out, and name the video device in sensor.device");
}

void check_genicam_format(TomlTable& sensor, const drivers::GenicamSensorOptions& options) {
    static constexpr std::array<std::pair<std::string_view, int>, 8> kFormats{{{"Mono8", 8},
                                                                               {"Mono10", 10},
                                                                               {"Mono10p", 10},
                                                                               {"Mono10Packed", 10},
                                                                               {"Mono12", 12},
                                                                               {"Mono12p", 12},
                                                                               {"Mono12Packed", 12},
                                                                               {"Mono16", 16}}};
    if (options.pixel_format.empty()) return;
    const auto* const known =
        std::ranges::find(kFormats, options.pixel_format, &std::pair<std::string_view, int>::first);
    if (known == kFormats.end())
        sensor.problem("pixel_format", "is no grey format that the station reads",
                       "use Mono8, Mono10, Mono10p, Mono10Packed, Mono12, Mono12p, Mono12Packed or Mono16; or leave it "
                       "out");
    else if (known->second != options.bits)
        sensor.problem("pixel_format",
                       "has samples of " + std::to_string(known->second) + " bits, and sensor.bits is " +
                           std::to_string(options.bits),
                       "change one of them, or leave pixel_format out");
}

// The keys of a GenICam camera alone; `options` has those that all cameras share.
void read_genicam(TomlTable& sensor, bool chosen, drivers::GenicamSensorOptions& options) {
    sensor.integer("offset_x_px", options.offset_x_px, 0, 65'535);
    sensor.integer("offset_y_px", options.offset_y_px, 0, 65'535);
    sensor.text("pixel_format", options.pixel_format);
    sensor.choice("trigger", {"line", "software", "free"}, options.trigger);
    sensor.text("trigger_source", options.trigger_source);
    sensor.integer("packet_bytes", options.packet_bytes, 0, 16'000);
    if (options.packet_bytes > 0 && options.packet_bytes < drivers::kSmallestGvspPacket)
        sensor.problem("packet_bytes", "is smaller than every GigE Vision camera's packets",
                       "set 0, which negotiates it, or 576 to the MTU of the whole way");
    sensor.integer("socket_buffer_bytes", options.socket_buffer_bytes, 0, 1 << 30);
    for (TomlTable& feature : sensor.tables("feature")) {
        auto& [name, value] = options.features.emplace_back();
        feature.text("name", name);
        feature.scalar("value", value);
        if (name.empty()) feature.problem("name", "is missing", "name the feature as the camera's manual does");
        if (!feature.has("value")) feature.problem("value", "is missing", "say what the feature is set to");
        for (const auto& [of_camera, key] : {std::pair("PixelFormat", "sensor.pixel_format"),
                                             {"Width", "sensor.width_px"},
                                             {"Height", "sensor.height_px"},
                                             {"TriggerMode", "sensor.trigger"},
                                             {"TriggerSource", "sensor.trigger_source"},
                                             {"OffsetX", "sensor.offset_x_px"},
                                             {"OffsetY", "sensor.offset_y_px"}}) {
            // A camera has no other feature whose name differs by its letters' case alone.
            if (chosen && ::strcasecmp(name.c_str(), of_camera) == 0)
                feature.problem("name", "would override " + std::string(key), "set " + std::string(key) + " instead");
        }
        for (const char* const by_station : {"AcquisitionMode", "AcquisitionStart", "AcquisitionStop"}) {
            if (chosen && ::strcasecmp(name.c_str(), by_station) == 0)
                feature.problem("name", std::string("is the station's: it sets ") + by_station + " by itself",
                                "take it out");
        }
    }
    if (chosen && options.trigger == drivers::CameraTrigger::line && options.trigger_source.empty()) {
        sensor.problem("trigger_source", "is missing",
                       "name the camera's input that the strobe's line triggers, such as \"Line1\"; or set trigger to "
                       "\"software\" or \"free\"");
    }
    refuse(sensor, chosen && options.trigger != drivers::CameraTrigger::line && !options.trigger_source.empty(),
           "trigger_source", "take it out, or set trigger to \"line\"", "has no effect with this sensor.trigger");
    if (chosen && options.trigger == drivers::CameraTrigger::line && options.trigger_source == "Software")
        sensor.problem("trigger_source", "is no input",
                       "name the camera's input, such as \"Line1\"; or set trigger to "
                       "\"software\"");
    if (chosen) check_genicam_format(sensor, options);
}

}  // namespace

void read_sensor(TomlTable sensor, SensorConfig& value, const std::filesystem::path& folder) {
    int backend = 0;
    sensor.choice("backend", {"simulated", "frames", "v4l2", "libcamera", "genicam"}, backend);
    std::string frames, scenes;
    sensor.text("folder", frames);
    sensor.text("scenes", scenes);
    refuse(sensor, backend != 0 && !scenes.empty(), "scenes", "take it out: only the simulated sensor has scenes");
    refuse(sensor, backend != 1 && !frames.empty(), "folder", "take it out, or set sensor.backend to \"frames\"");
    if (backend == 0 && !scenes.empty()) value = SimulatedSensor{folder / scenes};
    drivers::V4l2SensorOptions video;
    sensor.text("device", video.device);
    std::string camera;
    sensor.text("camera", camera);
    bool green = false;
    sensor.boolean("green", green);
    sensor.integer("width_px", video.width_px, 0, 65'535);
    sensor.integer("height_px", video.height_px, 0, 65'535);
    sensor.integer("bits", video.bits, 8, 16);
    sensor.integer("buffers", video.buffers, drivers::CameraSensor::kMinBuffers, drivers::CameraSensor::kMaxBuffers);
    if (video.bits != 8 && video.bits != 10 && video.bits != 12 && video.bits != 16) {
        sensor.problem("bits", "is no depth that a video device has", "use 8, 10, 12 or 16");
    }
    for (TomlTable& control : sensor.tables("control")) {
        auto& [name, setting] = video.controls.emplace_back();
        control.text("name", name);
        control.integer("value", setting, INT32_MIN, INT32_MAX);
        if (name.empty())
            control.problem("name", "is missing",
                            "name the control as v4l2-ctl --list-ctrls, or cam --list-controls, calls it");
        if (!control.has("value")) control.problem("value", "is missing", "say what the control is set to");
    }
    drivers::GenicamSensorOptions genicam{.camera = camera,
                                          .width_px = video.width_px,
                                          .height_px = video.height_px,
                                          .bits = video.bits,
                                          .buffers = video.buffers};
    read_genicam(sensor, backend == 4, genicam);
    refuse_other_cameras_keys(sensor, backend, video, genicam, green);
    if (backend == 4) value = genicam;
    if (backend == 2) value = video;
    if (backend == 3)
        value = drivers::LibcameraSensorOptions{camera,        video.width_px, video.height_px, video.bits,
                                                video.buffers, green,          video.controls};
    if (backend != 1) return;
    if (frames.empty()) sensor.problem("folder", "is missing", "name the folder of the recorded frames");
    value = FrameFolder{folder / frames};
}

namespace {

// The profile's addresses, overridden by the keys in the file.
void read_module(TomlTable& rejector, drivers::ModuleMap& map) {
    std::vector<std::string_view> names;
    for (const ModuleProfile& profile : module_profiles()) names.push_back(profile.name);
    if (const auto chosen = rejector.choice("profile", names)) map = module_profiles()[*chosen].map;
    rejector.integer("read_back_offset", map.read_back_offset, 0, 65535);
    rejector.integer("pulse_coil_offset", map.pulse_coil_offset, -1, 65535);
    rejector.integer("pulse_width_register", map.pulse_width_register, -1, 65535);
    ms(rejector, "pulse_width_unit_ms", map.pulse_width_unit, 0.001, 1000);
    rejector.integer("watchdog_time_register", map.watchdog_time_register, -1, 65535);
    ms(rejector, "watchdog_unit_ms", map.watchdog_unit, 0.1, 60'000);
    rejector.integer("watchdog_trigger_register", map.watchdog_trigger_register, -1, 65535);
    rejector.integer("watchdog_stop_register", map.watchdog_stop_register, -1, 65535);
    rejector.integer("watchdog_stop_value", map.watchdog_stop_value, 0, 65535);
    rejector.integer("alarm_coil", map.alarm_coil, -1, 65535);
}

void check_module(TomlTable& rejector, const drivers::ModbusRejectorOptions& modbus, const CoreConfig& core) {
    const drivers::ModuleAddress& address = modbus.address;
    const drivers::ModuleMap& map = modbus.map;
    for (const auto& [key, coil, other] : {std::tuple("reject_coil", modbus.ejector_coil, modbus.permit_coil),
                                           {"run_permit_coil", modbus.permit_coil, modbus.ejector_coil}}) {
        if (const std::string why = drivers::not_an_output(map, coil, other); !why.empty())
            rejector.problem(key, "is " + std::to_string(coil) + ", which " + why,
                             "give each output a coil of its own; docs/hardware.md says which coils a profile has");
    }
    if (address.serial && (address.unit < 1 || address.unit > 247))
        rejector.problem("unit", "is none of a serial line", "use 1 to 247");
    if (address.serial && address.port != drivers::ModuleAddress{}.port) {
        rejector.problem("port", "is given, and a serial line, too", "name either rejector.device, or host and port");
    }
    if (modbus.module_pulse > Duration::zero()) {
        if (map.pulse_coil_offset < 0) {
            rejector.problem("module_pulse_ms", "asks for a pulse that this module does not time",
                             "choose the profile of a module that does, or leave it 0");
        }
        if (modbus.module_pulse > core.reject_pulse)
            rejector.problem("module_pulse_ms", "is longer than pulse_ms",
                             "a command acts only where the module's whole pulse fits into pulse_ms");
        if (modbus.energise_to_pass)
            rejector.problem("module_pulse_ms", "cannot be with energise_to = \"pass\"",
                             "a module pulses an output on, not off: leave it 0");
        if (map.pulse_width_register >= 0 && modbus.module_pulse < map.pulse_width_unit) {
            rejector.problem("module_pulse_ms", "is shorter than pulse_width_unit_ms",
                             "the module cannot be told that");
        }
    }
    if (modbus.watchdog > Duration::zero()) {
        if (map.watchdog_time_register < 0 || map.watchdog_trigger_register < 0 || map.watchdog_stop_register < 0) {
            rejector.problem(
                "watchdog_ms", "cannot be set in this module over Modbus",
                "set it in the module itself and leave this 0; the station asks often enough to keep it alive");
        }
        if (modbus.watchdog < 3 * modbus.response_timeout)
            rejector.problem("watchdog_ms", "is shorter than three response_timeout_ms",
                             "one lost answer would stop the line");
        if (modbus.watchdog / map.watchdog_unit > 65535)
            rejector.problem("watchdog_ms", "does not fit into the module's register", "shorten it");
    }
    if (modbus.confirm_input >= 0 && modbus.confirm_within + modbus.response_timeout >= core.confirm_timeout) {
        rejector.problem("confirm_within_ms", "and response_timeout_ms end after confirm_timeout_ms",
                         "raise confirm_timeout_ms: until then the station waits for the confirmation");
    } else if (modbus.response_timeout >= core.confirm_timeout) {
        rejector.problem("confirm_timeout_ms", "is not longer than response_timeout_ms",
                         "raise it: until then the station waits for the module's answer");
    }
}

void refuse_other_modules_keys(TomlTable& rejector, bool real, const drivers::ModbusRejectorOptions& modbus,
                               const drivers::SerialSettings& serial) {
    const drivers::ModbusRejectorOptions unset;
    const drivers::SerialSettings unset_line;
    const bool other_host = modbus.address.host != unset.address.host, line = !serial.device.empty();
    const char* const simulated = "take it out, or set rejector.backend to \"modbus\"";
    refuse(rejector, !real && other_host, "host", simulated);
    refuse(rejector, !real && modbus.address.port != unset.address.port, "port", simulated);
    refuse(rejector, !real && line, "device", simulated);
    refuse(rejector, real && line && other_host, "host", "name either rejector.device, or host and port",
           "is given, and a serial line, too");
    constexpr std::string_view kNoLine = "has no effect without rejector.device";
    const char* const no_line = "take it out, or name the serial line in rejector.device";
    refuse(rejector, !line && serial.baud != unset_line.baud, "baud", no_line, kNoLine);
    refuse(rejector, !line && serial.parity != unset_line.parity, "parity", no_line, kNoLine);
    refuse(rejector, !line && serial.rs485 != unset_line.rs485, "rs485", no_line, kNoLine);
    constexpr std::string_view kNoSensor = "has no effect without rejector.confirm_input";
    const char* const no_sensor = "take it out, or name the sensor's input in rejector.confirm_input";
    const bool confirms = modbus.confirm_input >= 0;
    refuse(rejector, !confirms && modbus.confirm_active_low, "confirm_active_low", no_sensor, kNoSensor);
    refuse(rejector, !confirms && modbus.confirm_within != unset.confirm_within, "confirm_within_ms", no_sensor,
           kNoSensor);
}

}  // namespace

void read_rejector(TomlTable rejector, RejectorConfig& value, CoreConfig& core) {
    bool real = false;
    rejector.choice("backend", {"simulated", "modbus"}, real);
    drivers::ModbusRejectorOptions modbus;
    drivers::ModuleAddress& address = modbus.address;
    drivers::SerialSettings serial;
    host(rejector, "host", address.host);
    rejector.integer("port", address.port, 1, 65535);
    rejector.text("device", serial.device);
    baud(rejector, serial.baud);
    std::size_t parity = 1;
    rejector.choice("parity", {"none", "even", "odd"}, parity);
    serial.parity = "NEO"[parity];
    rejector.boolean("rs485", serial.rs485);
    if (!serial.device.empty()) address.serial = serial;
    rejector.integer("unit", address.unit, 0, 255);
    read_module(rejector, modbus.map);
    rejector.integer("reject_coil", modbus.ejector_coil, 0, 65535);
    rejector.integer("run_permit_coil", modbus.permit_coil, 0, 65535);
    rejector.choice("energise_to", {"reject", "pass"}, modbus.energise_to_pass);
    ms(rejector, "module_pulse_ms", modbus.module_pulse, 0, 10'000);
    rejector.integer("confirm_input", modbus.confirm_input, -1, 65535);
    rejector.boolean("confirm_active_low", modbus.confirm_active_low);
    ms(rejector, "confirm_within_ms", modbus.confirm_within, 0.1, 60'000);
    ms(rejector, "watchdog_ms", modbus.watchdog, 0, 600'000);
    ms(rejector, "response_timeout_ms", modbus.response_timeout, 5, 1000);
    ms(rejector, "lead_ms", core.reject_lead, 0, 10'000);
    ms(rejector, "early_ms", core.reject_early, 0.1, 10'000);
    ms(rejector, "pulse_ms", core.reject_pulse, 0.1, 10'000);
    ms(rejector, "confirm_timeout_ms", core.confirm_timeout, 1, 60'000);
    check_module(rejector, modbus, core);
    refuse_other_modules_keys(rejector, real, modbus, serial);
    if (real) value = modbus;
    else value = SimulatedRejector{modbus};
}

namespace {

void read_limits(TomlTable& table, drivers::LightLimits& limits) {
    us(table, "max_on_us", limits.max_on, 1, 1'000'000);
    ms(table, "min_rest_ms", limits.min_rest, 0, 60'000);
    table.number("max_duty", limits.max_duty, 0.0001, 1);
}

// Checks the limits of one channel against the pulses of the station.
void check_light(TomlTable& table, const CoreConfig& core, const drivers::LightLimits& limits) {
    if (core.strobe > limits.max_on) {
        table.problem("max_on_us", "is shorter than timing.strobe_us", "shorten the pulse; the limit protects the LED");
    }
    const Duration least = core.min_gap - core.strobe;
    if (least < limits.min_rest) {
        table.problem("min_rest_ms", "is longer than parts that follow at line.min_gap_ms leave",
                      "raise line.min_gap_ms or shorten the pulse");
    }
    if (static_cast<double>(core.strobe.count()) > limits.max_duty * static_cast<double>(core.min_gap.count())) {
        table.problem("max_duty", "is exceeded by parts that follow at line.min_gap_ms",
                      "raise line.min_gap_ms or shorten the pulse");
    }
}

}  // namespace

namespace {

// Keys of a channel behind a strobe controller. `limits` are those of [strobe].
drivers::GardasoftChannel controller_channel(TomlTable& table, const drivers::LightLimits& limits) {
    drivers::GardasoftChannel channel{.limits = limits};
    table.integer("output", channel.output, 1, 8);
    table.integer("rated_ma", channel.rated_ma, 10, 3000);
    table.number("brightness_percent", channel.brightness_percent, 1, 999);
    table.integer("max_ma", channel.max_ma, 10, 20'000);
    return channel;
}

void check_controller(TomlTable& strobe, std::vector<TomlTable>& tables, const StrobeController& controller) {
    const drivers::GardasoftStrobeOptions& options = controller.gardasoft;
    if (options.device.empty() == options.host.empty())
        strobe.problem("host", options.host.empty() ? "is missing" : "is given, and a serial line, too",
                       "name either strobe.host or strobe.device");
    if (options.pulse < drivers::kGardasoftShortest || options.pulse > drivers::kGardasoftLongest ||
        options.pulse % std::chrono::microseconds(1) != Duration::zero())
        strobe.problem("backend", "cannot time the pulse of timing.strobe_us",
                       "a Gardasoft controller times 20 us to 999 ms, in whole microseconds");
    if (tables.size() > 8)
        strobe.problem("channel", "is there more than 8 times", "a controller has at most 8 outputs");
    for (std::size_t k = 0; k < tables.size(); ++k) {
        const drivers::GardasoftChannel& channel = options.channels[k];
        if (!tables[k].has("output")) tables[k].problem("output", "is missing", "name the controller's output, from 1");
        if (!tables[k].has("rated_ma"))
            tables[k].problem("rated_ma", "is missing", "copy the current from the light's label");
        else if (const auto wrong = drivers::problem_of(channel, options.pulse); !wrong.key.empty())
            tables[k].problem(wrong.key, wrong.what, wrong.cure);
        if (options.pulse + channel.limits.rest_after(options.pulse) > drivers::kGardasoftLongest)
            tables[k].problem("min_rest_ms", "and the pulse are longer than the 999 ms that the controller can wait",
                              "shorten it, or raise max_duty");
        for (std::size_t j = 0; j < k; ++j) {
            if (options.channels[j].output == channel.output)
                tables[k].problem("output", "lights another channel, too", "give each channel an output of its own");
        }
    }
}

// Two channels on one line would light both.
void check_lines(std::vector<TomlTable>& tables, const std::vector<drivers::GpioLine>& lines) {
    for (std::size_t k = 0; k < lines.size(); ++k) {
        check_gpio_line(tables[k], lines[k]);
        for (std::size_t j = 0; j < k; ++j) {
            if (lines[j].chip == lines[k].chip && lines[j].line == lines[k].line)
                tables[k].problem("line", "lights another channel, too", "give each channel a line of its own");
        }
    }
}

}  // namespace

namespace {

// The camera exposes for as long as the light is on, and the station triggers it: nothing else may make it expose.
void read_camera_light(TomlTable& strobe, const StrobeConfig& value, const CoreConfig& core, SensorConfig& sensor) {
    constexpr std::string_view kKey = "backend";
    auto* const camera = std::get_if<drivers::GenicamSensorOptions>(&sensor);
    if (value.camera_line.empty())
        strobe.problem("camera_line", "is missing",
                       "name the camera's output that the light is wired to, as \"Line2\"");
    if (value.channels != 1) strobe.problem("channels", "is not 1", "a camera has one light");
    if (core.strobe_delay != Duration::zero())
        strobe.problem(kKey, "cannot delay the light by timing.strobe_delay_us",
                       "set that to 0: light and exposure are one");
    if (core.strobe % std::chrono::microseconds(1) != Duration::zero())
        strobe.problem(kKey, "cannot light for timing.strobe_us", "use whole microseconds");
    if (camera == nullptr || camera->trigger != drivers::CameraTrigger::software)
        return strobe.problem(kKey, "needs a GenICam camera that the station triggers",
                              "set sensor.backend to \"genicam\" and sensor.trigger to \"software\"");
    for (const auto& [name, setting] : camera->features) {
        if (name.starts_with("ExposureTime"))
            strobe.problem(kKey, "sets the camera's " + name + " to timing.strobe_us",
                           "take it out of [[sensor.feature]]");
    }
    camera->light_line = value.camera_line;
    camera->light_us = core.strobe / std::chrono::microseconds(1);
}

enum class StrobeBackend : std::uint8_t { simulated, gpio, gardasoft, camera };

void refuse_other_lights_keys(TomlTable& strobe, std::vector<TomlTable>& channels, StrobeBackend backend, bool by_line,
                              const std::string& camera_line, const drivers::GardasoftStrobeOptions& options) {
    using enum StrobeBackend;
    refuse(strobe, backend != camera && !camera_line.empty(), "camera_line",
           "take it out, or set strobe.backend to \"camera\"");
    if (backend != gardasoft) {
        const drivers::GardasoftStrobeOptions unset;
        const char* const cure = "take it out, or set strobe.backend to \"gardasoft\"";
        refuse(strobe, !options.host.empty(), "host", cure);
        refuse(strobe, options.port != unset.port, "port", cure);
        refuse(strobe, !options.device.empty(), "device", cure);
        refuse(strobe, !by_line, "trigger", cure);
        refuse(strobe, options.delay != unset.delay, "delay_us", cure);
        refuse(strobe, options.response_timeout != unset.response_timeout, "response_timeout_ms", cure);
    }
    refuse(strobe, (backend == simulated || backend == camera) && !channels.empty(), "channel",
           "take it out: only the backends \"gpio\" and \"gardasoft\" have channels of their own");
    for (TomlTable& channel : channels) {
        if (backend == gpio) {
            for (const char* key : {"output", "rated_ma", "brightness_percent", "max_ma"})
                refuse(channel, channel.has(key), key, "take it out: only a strobe controller has it");
        } else if (backend == gardasoft && !by_line) {
            for (const char* key : {"chip", "line", "active_low"})
                refuse(channel, channel.has(key), key, "take it out, or set strobe.trigger to \"line\"",
                       "has no effect with strobe.trigger = \"command\"");
        }
    }
}

}  // namespace

void read_strobe(TomlTable strobe, StrobeConfig& value, CoreConfig& core, SensorConfig* seen_by) {
    using Backend = StrobeBackend;
    Backend backend{};
    strobe.choice("backend", {"simulated", "gpio", "gardasoft", "camera"}, backend);
    strobe.integer("channels", value.channels, 1, 32);
    read_limits(strobe, value.limits);
    std::string camera_line;
    strobe.text("camera_line", camera_line);
    StrobeController controller;
    drivers::GardasoftStrobeOptions& gardasoft = controller.gardasoft;
    if (strobe.has("host") && backend == Backend::gardasoft) host(strobe, "host", gardasoft.host);
    else strobe.text("host", gardasoft.host);
    strobe.integer("port", gardasoft.port, 1, 65535);
    strobe.text("device", gardasoft.device);
    bool by_line = true;
    strobe.choice("trigger", {"command", "line"}, by_line);
    us(strobe, "delay_us", gardasoft.delay, 20, 999'000);
    ms(strobe, "response_timeout_ms", gardasoft.response_timeout, 10, 1000);
    gardasoft.pulse = core.strobe;
    std::vector<TomlTable> channels = strobe.tables("channel");
    std::vector<drivers::GpioStrobeChannel> gpio;
    std::vector<drivers::GpioLine> lines;
    std::vector<drivers::LightLimits> limits;
    for (TomlTable& table : channels) {
        lines.push_back(gpio_line(table, false));
        drivers::GardasoftChannel output = controller_channel(table, value.limits);
        read_limits(table, output.limits);
        limits.push_back(output.limits);
        gpio.push_back({lines.back(), output.limits});
        gardasoft.channels.push_back(output);
    }
    refuse_other_lights_keys(strobe, channels, backend, by_line, camera_line, gardasoft);
    if (backend == Backend::camera) {
        value.camera_line = camera_line;
        if (seen_by != nullptr) read_camera_light(strobe, value, core, *seen_by);
    } else if (backend != Backend::simulated) {
        if (channels.empty() || channels.size() > 32)
            strobe.problem("channel", "must be there 1 to 32 times",
                           "describe every collimator in a [[strobe.channel]]");
        const int described = static_cast<int>(channels.size());
        if (strobe.has("channels") && value.channels != described) {
            strobe.problem("channels", "differs from the number of [[strobe.channel]]",
                           "leave it out: they are counted");
        }
        value.channels = std::max(1, described);
    }
    if (backend == Backend::gpio || (backend == Backend::gardasoft && by_line)) check_lines(channels, lines);
    if (backend == Backend::gpio) value.gpio = std::move(gpio);
    if (backend == Backend::gardasoft) {
        if (gardasoft.delay % std::chrono::microseconds(1) != Duration::zero())
            strobe.problem("delay_us", "is no whole number", "the controller knows whole microseconds");
        check_controller(strobe, channels, controller);
        if (by_line) controller.triggers = std::move(lines);
        value.controller = std::move(controller);
    }
    std::vector<double> lit{0};
    strobe.numbers("lit", lit, 1, 32);
    core.strobe_channels = 0;
    for (const double channel : lit) {
        if (channel < 0 || channel >= value.channels || channel != std::floor(channel)) {
            strobe.problem("lit", "names a channel that does not exist", "use 0 to strobe.channels less one");
            continue;
        }
        core.strobe_channels |= 1U << static_cast<unsigned>(channel);
    }
    if (value.gpio.empty() && !value.controller) return check_light(strobe, core, value.limits);
    for (std::size_t k = 0; k < channels.size(); ++k) {
        if (((core.strobe_channels >> k) & 1U) != 0) check_light(channels[k], core, limits[k]);
    }
}

namespace {

void read_camera_barrier(TomlTable& table, const CameraInput& input, const CoreConfig& core, SensorConfig& sensor) {
    constexpr std::string_view kKey = "backend";
    auto* const camera = std::get_if<drivers::GenicamSensorOptions>(&sensor);
    if (input.line.empty())
        table.problem("camera_line", "is missing",
                      "name the camera's input that the light barrier is wired to, as \"Line1\"");
    if (core.by_encoder)
        table.problem(kKey, "has no encoder, and line.tracking is \"encoder\"",
                      "track by time, or use part_sensor.backend = \"gpio\"");
    if (camera == nullptr) return table.problem(kKey, "needs a GenICam camera", "set sensor.backend to \"genicam\"");
    if (!input.line.empty() && input.line == camera->light_line)
        table.problem("camera_line", "is the light's output, too", "wire barrier and light to lines of their own");
    camera->barrier_line = input.line;
}

}  // namespace

void read_part_sensor(TomlTable sensor, PartSensorConfig& value, const CoreConfig& core, SensorConfig* seen_by) {
    enum class Backend : std::uint8_t { simulated, gpio, camera };
    Backend backend{};
    sensor.choice("backend", {"simulated", "gpio", "camera"}, backend);
    CameraInput input;
    sensor.text("camera_line", input.line);
    drivers::GpioPartSensorOptions gpio;
    gpio.line = gpio_line(sensor, true);
    us(sensor, "debounce_us", gpio.debounce, 0, 100'000);
    const bool has_encoder = sensor.has("encoder");
    TomlTable encoder = sensor.table("encoder");
    const drivers::GpioLine encoder_line = gpio_line(encoder, true);
    ms(encoder, "every_ms", gpio.encoder_every, 1, 1000);
    if (has_encoder) gpio.encoder = encoder_line;
    if (backend != Backend::gpio) {
        const drivers::GpioPartSensorOptions unset;
        const char* const cure = "take it out, or set part_sensor.backend to \"gpio\"";
        refuse(sensor, !gpio.line.chip.empty(), "chip", cure);
        refuse(sensor, !gpio.line.line.empty(), "line", cure);
        refuse(sensor, gpio.line.bias != unset.line.bias, "bias", cure);
        refuse(sensor, gpio.debounce != unset.debounce, "debounce_us",
               backend == Backend::camera
                   ? "take it out: the camera debounces its input, by a feature such as LineDebouncerTime"
                   : cure);
        refuse(sensor, has_encoder, "encoder", cure);
    }
    refuse(sensor, backend != Backend::camera && !input.line.empty(), "camera_line",
           "take it out, or set part_sensor.backend to \"camera\"");
    if (backend == Backend::camera) {
        input.active_low = gpio.line.active_low;
        if (seen_by != nullptr) read_camera_barrier(sensor, input, core, *seen_by);
        value = input;
    }
    if (backend != Backend::gpio) return;
    check_gpio_line(sensor, gpio.line);
    if (has_encoder) check_gpio_line(encoder, encoder_line);
    if (core.by_encoder && !has_encoder) {
        sensor.problem("encoder", "is missing, and line.tracking is \"encoder\"",
                       "describe it in [part_sensor.encoder], or track by time");
    }
    if (!core.by_encoder && core.exposure_delay <= gpio.debounce) {
        sensor.problem("debounce_us", "ends after the exposure has begun",
                       "shorten it, or raise line.exposure_delay_ms");
    }
    value = gpio;
}

}  // namespace hord::firmware
