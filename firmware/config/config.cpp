#include "firmware/config/config.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "algo/frame/extents.h"
#include "common/toml_fields.h"
#include "firmware/config/module_profiles.h"

namespace hord::firmware {
namespace {

using common::TomlProblems;
using common::TomlTable;

// A key in milliseconds or microseconds, as its name says, rounded to nanoseconds.
void duration(TomlTable& table, std::string_view key, Duration& value, double unit_ns, double low, double high) {
    double number = static_cast<double>(value.count()) / unit_ns;
    table.number(key, number, low, high);
    value = Duration(std::llround(number * unit_ns));
}
void ms(TomlTable& table, std::string_view key, Duration& value, double low, double high) {
    duration(table, key, value, 1e6, low, high);
}
void us(TomlTable& table, std::string_view key, Duration& value, double low, double high) {
    duration(table, key, value, 1e3, low, high);
}

// "9x9": bin columns by bin rows.
void macro(TomlTable& table, std::string_view key, int& bins_i, int& bins_j) {
    std::string text = std::to_string(bins_i) + "x" + std::to_string(bins_j);
    table.text(key, text);
    int i = 0, j = 0;
    const char* end = text.data() + text.size();
    const auto first = std::from_chars(text.data(), end, i);
    const bool cross = first.ec == std::errc() && first.ptr != end && *first.ptr == 'x';
    const auto second =
        cross ? std::from_chars(first.ptr + 1, end, j) : std::from_chars_result{end, std::errc::invalid_argument};
    const bool in_range = i >= algo::kMinBins && i <= algo::kMaxBins && j >= algo::kMinBins && j <= algo::kMaxBins;
    if (second.ec != std::errc() || second.ptr != end || !in_range) {
        return table.problem(key, "\"" + text + "\" is not a macro-pixel",
                             "write columns x rows, 3 to 15 bins a side, as in \"9x9\"");
    }
    bins_i = i;
    bins_j = j;
}

void host(TomlTable& table, std::string_view key, std::string& value) {
    table.text(key, value);
    if (value.empty()) table.problem(key, "is empty", "give a host name or an address");
}

void read_line(TomlTable line, CoreConfig& core) {
    constexpr std::array<std::string_view, 2> kinds{"time", "encoder"};
    if (const auto kind = line.choice("tracking", kinds)) core.by_encoder = *kind == 1;
    ms(line, "transport_ms", core.transport, 1, 600'000);
    line.integer("transport_counts", core.transport_counts, 1, 1'000'000'000);
    ms(line, "encoder_timeout_ms", core.encoder_timeout, 1, 60'000);
    ms(line, "exposure_delay_ms", core.exposure_delay, 0, 60'000);
    line.integer("exposure_counts", core.exposure_counts, 0, 1'000'000'000);
    ms(line, "min_gap_ms", core.min_gap, 0.1, 60'000);
    line.integer("min_gap_counts", core.min_gap_counts, 1, 1'000'000'000);
    ms(line, "max_part_ms", core.max_part, 0, 60'000);
    line.integer("max_part_counts", core.max_part_counts, 0, 1'000'000'000);
    line.integer("max_parts", core.max_parts, 1, kLineCapacity);
}

void read_timing(TomlTable timing, CoreConfig& core) {
    us(timing, "exposure_us", core.exposure, 1, 1'000'000);
    ms(timing, "trigger_lead_ms", core.trigger_lead, 0, 60'000);
    us(timing, "strobe_delay_us", core.strobe_delay, 0, 1'000'000);
    us(timing, "strobe_us", core.strobe, 1, 1'000'000);
    us(timing, "strobe_window_us", core.strobe_window, 1, 1'000'000);
    us(timing, "frame_window_us", core.frame_window, 1, 10'000'000);
    ms(timing, "frame_timeout_ms", core.frame_timeout, 1, 60'000);
}

// A GPIO line in `table`, as keys "chip", "line", "active_low" and, for an input, "bias".
GpioLineName gpio_line(TomlTable& table, bool input) {
    constexpr std::array<std::string_view, 4> biases{"as-is", "disabled", "pull-up", "pull-down"};
    GpioLineName line;
    table.text("chip", line.chip);
    table.text("line", line.line);
    table.boolean("active_low", line.active_low);
    if (input) {
        if (const auto bias = table.choice("bias", biases)) line.bias = static_cast<GpioLineName::Bias>(*bias);
    }
    return line;
}
void check_gpio_line(TomlTable& table, const GpioLineName& line) {
    if (line.chip.empty())
        table.problem("chip", "is missing", "name the GPIO chip by its label, as gpiodetect prints it");
    if (line.line.empty())
        table.problem("line", "is missing", "name the line, or give its offset as \"6\"; see gpioinfo");
}

void read_sensor(TomlTable sensor, SensorConfig& value, const std::filesystem::path& folder) {
    constexpr std::array<std::string_view, 4> kinds{"simulated", "frames", "v4l2", "libcamera"};
    const auto kind = sensor.choice("backend", kinds);
    std::string frames;
    sensor.text("folder", frames);
    VideoSensor video;
    sensor.text("device", video.device);
    std::string camera;
    sensor.text("camera", camera);
    bool green = false;
    sensor.boolean("green", green);
    sensor.integer("width_px", video.width_px, 0, 65'535);
    sensor.integer("height_px", video.height_px, 0, 65'535);
    sensor.integer("bits", video.bits, 8, 16);
    sensor.integer("buffers", video.buffers, 2, 32);
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
    if (kind == 2) value = video;
    if (kind == 3)
        value = CameraSensor{camera, video.width_px, video.height_px, video.bits, video.buffers, green, video.controls};
    if (kind != 1) return;
    if (frames.empty()) sensor.problem("folder", "is missing", "name the folder of the recorded frames");
    value = RecordedFrames{folder / frames};
}

// What is particular about the module: its profile's, and what the file says instead.
void read_module(TomlTable& rejector, hal::ModuleMap& map) {
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

void check_module(TomlTable& rejector, const ModbusRejector& modbus, const CoreConfig& core) {
    const hal::ModuleMap& map = modbus.map;
    if (modbus.reject_coil == modbus.run_permit_coil) {
        rejector.problem("run_permit_coil", "is the ejector's coil, too", "give each output a coil of its own");
    }
    if (!modbus.device.empty() && (modbus.unit < 1 || modbus.unit > 247))
        rejector.problem("unit", "is none of a serial line", "use 1 to 247");
    if (!modbus.device.empty() && modbus.port != ModbusRejector{}.port) {
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
    }
}

void read_rejector(TomlTable rejector, RejectorConfig& value, CoreConfig& core) {
    constexpr std::array<std::string_view, 2> kinds{"simulated", "modbus"};
    constexpr std::array<std::string_view, 2> sides{"reject", "pass"};
    constexpr std::array<std::string_view, 3> parities{"none", "even", "odd"};
    const auto kind = rejector.choice("backend", kinds);
    ModbusRejector modbus;
    host(rejector, "host", modbus.host);
    rejector.integer("port", modbus.port, 1, 65535);
    rejector.text("device", modbus.device);
    rejector.integer("baud", modbus.baud, 1200, 921'600);
    if (const auto parity = rejector.choice("parity", parities)) modbus.parity = "NEO"[*parity];
    rejector.boolean("rs485", modbus.rs485);
    rejector.integer("unit", modbus.unit, 0, 255);
    read_module(rejector, modbus.map);
    rejector.integer("reject_coil", modbus.reject_coil, 0, 65535);
    rejector.integer("run_permit_coil", modbus.run_permit_coil, 0, 65535);
    if (const auto side = rejector.choice("energise_to", sides)) modbus.energise_to_pass = *side == 1;
    ms(rejector, "module_pulse_ms", modbus.module_pulse, 0, 10'000);
    rejector.integer("confirm_input", modbus.confirm_input, -1, 65535);
    rejector.boolean("confirm_active_low", modbus.confirm_active_low);
    ms(rejector, "confirm_within_ms", modbus.confirm_within, 0.1, 60'000);
    ms(rejector, "watchdog_ms", modbus.watchdog, 0, 600'000);
    ms(rejector, "response_timeout_ms", modbus.response_timeout, 5, 1000);
    ms(rejector, "lead_ms", core.reject_lead, 0, 10'000);
    ms(rejector, "early_ms", core.reject_early, 0, 10'000);
    ms(rejector, "pulse_ms", core.reject_pulse, 0.1, 10'000);
    ms(rejector, "confirm_timeout_ms", core.confirm_timeout, 1, 60'000);
    check_module(rejector, modbus, core);
    if (kind == 1) value = modbus;
    else value = SimulatedRejector{modbus};
}

// The limits of one channel, against what the station will ask of it.
void check_light(TomlTable& table, const CoreConfig& core, Duration max_on, Duration min_rest, double max_duty) {
    if (core.strobe > max_on) {
        table.problem("max_on_us", "is shorter than timing.strobe_us", "shorten the pulse; the limit protects the LED");
    }
    const Duration least = core.min_gap - core.strobe;
    if (least < min_rest) {
        table.problem("min_rest_ms", "is longer than parts that follow at line.min_gap_ms leave",
                      "raise line.min_gap_ms or shorten the pulse");
    }
    if (static_cast<double>(core.strobe.count()) > max_duty * static_cast<double>(core.min_gap.count())) {
        table.problem("max_duty", "is exceeded by parts that follow at line.min_gap_ms",
                      "raise line.min_gap_ms or shorten the pulse");
    }
}

void read_strobe(TomlTable strobe, StrobeConfig& value, CoreConfig& core) {
    constexpr std::array<std::string_view, 2> kinds{"simulated", "gpio"};
    const auto kind = strobe.choice("backend", kinds);
    strobe.integer("channels", value.channels, 1, 32);
    us(strobe, "max_on_us", value.max_on, 1, 1'000'000);
    ms(strobe, "min_rest_ms", value.min_rest, 0, 60'000);
    strobe.number("max_duty", value.max_duty, 0.0001, 1);
    std::vector<TomlTable> channels = strobe.tables("channel");
    std::vector<StrobeChannel> gpio;
    for (TomlTable& table : channels) {
        StrobeChannel& channel =
            gpio.emplace_back(StrobeChannel{gpio_line(table, false), value.max_on, value.min_rest, value.max_duty});
        us(table, "max_on_us", channel.max_on, 1, 1'000'000);
        ms(table, "min_rest_ms", channel.min_rest, 0, 60'000);
        table.number("max_duty", channel.max_duty, 0.0001, 1);
        if (kind != 1) continue;
        check_gpio_line(table, channel.line);
        for (std::size_t k = 0; k + 1 < gpio.size(); ++k) {
            if (gpio[k].line.chip == channel.line.chip && gpio[k].line.line == channel.line.line) {
                table.problem("line", "lights another channel, too", "give each channel a line of its own");
            }
        }
    }
    if (kind == 1) {
        if (gpio.empty() || gpio.size() > 32)
            strobe.problem("channel", "must be there 1 to 32 times",
                           "describe every collimator in a [[strobe.channel]]");
        const int described = static_cast<int>(gpio.size());
        if (strobe.has("channels") && value.channels != described) {
            strobe.problem("channels", "differs from the number of [[strobe.channel]]",
                           "leave it out: they are counted");
        }
        value.channels = std::max(1, described);
        value.gpio = std::move(gpio);
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
    if (value.gpio.empty()) return check_light(strobe, core, value.max_on, value.min_rest, value.max_duty);
    for (std::size_t k = 0; k < value.gpio.size(); ++k) {
        const StrobeChannel& channel = value.gpio[k];
        if (((core.strobe_channels >> k) & 1U) != 0)
            check_light(channels[k], core, channel.max_on, channel.min_rest, channel.max_duty);
    }
}

void read_part_sensor(TomlTable sensor, PartSensorConfig& value, const CoreConfig& core) {
    constexpr std::array<std::string_view, 2> kinds{"simulated", "gpio"};
    const auto kind = sensor.choice("backend", kinds);
    GpioPartSensorLine gpio;
    gpio.line = gpio_line(sensor, true);
    us(sensor, "debounce_us", gpio.debounce, 0, 100'000);
    const bool has_encoder = sensor.has("encoder");
    TomlTable encoder = sensor.table("encoder");
    const GpioLineName encoder_line = gpio_line(encoder, true);
    ms(encoder, "every_ms", gpio.encoder_every, 1, 1000);
    if (has_encoder) gpio.encoder = encoder_line;
    if (kind != 1) return;
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

// Who may write, then who may only read; addresses and networks.
std::vector<modbus::AccessRule> access(TomlTable& table) {
    std::vector<modbus::AccessRule> rules;
    const auto read = [&](std::string_view key, std::vector<std::string> networks, bool may_write) {
        table.texts(key, networks);
        for (const std::string& text : networks) {
            const auto network = modbus::parse_network(text);
            if (network) rules.push_back({*network, may_write});
            else table.problem(key, network.error().what, network.error().cure);
        }
    };
    read("may_write", {"127.0.0.0/8", "::1"}, true);
    read("may_read", {"0.0.0.0/0", "::/0"}, false);
    return rules;
}

void read_modbus(TomlTable table, TcpServer& value) {
    host(table, "host", value.host);
    table.integer("port", value.port, 0, 65535);
    table.integer("read_only_port", value.read_only_port, 0, 65535);
    table.integer("max_connections", value.max_connections, 1, 512);
    value.access = access(table);
    if (value.read_only_port != 0 && value.read_only_port == value.port) {
        table.problem("read_only_port", "is modbus.port, too", "give it another one, or 0 for none");
    }
}

void read_serial(TomlTable table, SerialLine& value) {
    constexpr std::array<std::string_view, 3> parities{"none", "even", "odd"};
    modbus::SerialOptions line;
    line.device.clear();
    table.text("device", line.device);
    table.integer("baud", line.baud, 1200, 921'600);
    if (const auto parity = table.choice("parity", parities))
        line.parity = static_cast<modbus::SerialOptions::Parity>(*parity);
    table.integer("unit", line.unit, 1, 247);
    table.boolean("rs485", line.rs485);
    table.boolean("may_write", line.may_write);
    ms(table, "gap_ms", line.gap, 1, 1000);
    if (!line.device.empty()) value = line;
}

void read_plc(TomlTable plc, PlcConfig& value, CoreConfig& core) {
    constexpr std::array<std::string_view, 3> policies{"none", "stop", "reject_all"};
    if (const auto policy = plc.choice("policy", policies)) core.plc_policy = static_cast<PlcPolicy>(*policy);
    ms(plc, "timeout_ms", value.timeout, 200, 60'000);
}

void read_inspection(TomlTable inspection, InspectionConfig& value, const std::filesystem::path& folder) {
    macro(inspection, "macro", value.bins_i, value.bins_j);
    std::string grid;
    inspection.text("grid", grid);
    if (!grid.empty()) value.grid = folder / grid;
    std::string recipe;
    inspection.text("recipe", recipe);
    if (!recipe.empty()) value.recipe = folder / recipe;
    std::string recipes = "recipes";
    inspection.text("recipes", recipes);
    if (!recipes.empty()) value.recipes = folder / recipes;
    inspection.integer("threads", value.threads, 1, 64);
    inspection.integer("queue", value.queue, 1, 256);
}

void read_optics(TomlTable optics, OpticsConfig& value) {
    optics.integer("window_parts", value.window_parts, 25, 1000);
    optics.number("least_light", value.least_light, 0.05, 0.95);
    optics.number("most_dark_drift_dn", value.most_dark_drift_dn, 0, 65535);
    optics.number("most_uneven", value.most_uneven, 0.02, 0.9);
}

void read_store(TomlTable store, StoreConfig& value, const std::filesystem::path& folder) {
    store.boolean("enabled", value.enabled);
    std::string where;
    store.text("folder", where);
    if (!where.empty()) value.folder = folder / where;
    store.integer("keep_days", value.keep_days, 0, 36'500);
    store.integer("keep_mb", value.keep_mb, 0, 10'000'000);
    store.integer("frames_mb", value.frames_mb, 0, 100'000'000);
    store.integer("free_mb", value.free_mb, 0, 100'000'000);
    store.integer("frames_before", value.frames_before, 0, 64);
    store.integer("frames_after", value.frames_after, 0, 64);
    store.integer("sample_every", value.sample_every, 0, 1'000'000'000);
    store.integer("frame_buffers", value.frame_buffers, 1, 1024);
    if (value.frames_before >= value.frame_buffers) {
        store.problem("frames_before", "is more than there are buffers for", "raise store.frame_buffers");
    }
}

Result<Config> read(TomlTable root, std::string_view name, const std::filesystem::path& folder, TomlProblems& found) {
    Config config;
    TomlTable station = root.table("station");
    station.text("name", config.name);
    station.boolean("autostart", config.autostart);
    ms(station, "heartbeat_ms", config.core.station_heartbeat, 10, 60'000);
    station.integer("max_failures_in_a_row", config.core.max_failures_in_a_row, 0, 1'000'000);
    read_line(root.table("line"), config.core);
    read_timing(root.table("timing"), config.core);
    read_sensor(root.table("sensor"), config.sensor, folder);
    read_rejector(root.table("rejector"), config.rejector, config.core);
    read_strobe(root.table("strobe"), config.strobe, config.core);
    read_part_sensor(root.table("part_sensor"), config.part_sensor, config.core);
    read_modbus(root.table("modbus"), config.modbus);
    read_serial(root.table("serial"), config.serial);
    read_plc(root.table("plc"), config.plc, config.core);
    read_inspection(root.table("inspection"), config.inspection, folder);
    read_optics(root.table("optics"), config.optics);
    read_store(root.table("store"), config.store, folder);
    root.refuse_unknown_keys();
    for (const std::string& problem : problems(config.core)) found.add(std::string(name) + ": " + problem);
    if (!found.empty()) return found.as_error();
    return config;
}

}  // namespace

std::vector<modbus::AccessRule> TcpServer::default_access() {
    TomlProblems none;
    TomlTable empty = TomlTable::parse_text("", "defaults", none);
    return hord::firmware::access(empty);
}

Result<Config> load_config(const std::filesystem::path& file) {
    TomlProblems found;
    TomlTable root = TomlTable::parse_file(file, found);
    if (!found.empty()) return found.as_error();
    auto config = read(std::move(root), file.string(), file.parent_path(), found);
    if (config) config->file = file;
    return config;
}

Result<Config> parse_config(std::string_view text, std::string_view name, const std::filesystem::path& folder) {
    TomlProblems found;
    TomlTable root = TomlTable::parse_text(text, name, found);
    if (!found.empty()) return found.as_error();
    return read(std::move(root), name, folder, found);
}

}  // namespace hord::firmware
