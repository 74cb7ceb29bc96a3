#include <algorithm>
#include <cmath>

#include "firmware/config/device_sections.h"
#include "firmware/config/shared_keys.h"

namespace hord::firmware {

using common::TomlTable;

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

// The keys of a strobe controller, whatever the backend: refuse_other_lights_keys() wants to see them.
void read_controller(TomlTable& strobe, bool used, drivers::GardasoftStrobeOptions& gardasoft, bool& by_line) {
    if (strobe.has("host") && used) host(strobe, "host", gardasoft.host);
    else strobe.text("host", gardasoft.host);
    strobe.integer("port", gardasoft.port, 1, 65535);
    strobe.text("device", gardasoft.device);
    strobe.choice("trigger", {"command", "line"}, by_line);
    us(strobe, "delay_us", gardasoft.delay, 20, 999'000);
    ms(strobe, "response_timeout_ms", gardasoft.response_timeout, 10, 1000);
}

// A light with channels of its own has as many as are described.
int described_channels(TomlTable& strobe, const std::vector<TomlTable>& channels, int said) {
    if (channels.empty() || channels.size() > 32)
        strobe.problem("channel", "must be there 1 to 32 times", "describe every collimator in a [[strobe.channel]]");
    const int described = static_cast<int>(channels.size());
    if (strobe.has("channels") && said != described) {
        strobe.problem("channels", "differs from the number of [[strobe.channel]]", "leave it out: they are counted");
    }
    return std::max(1, described);
}

// Which channels light up, as bits.
void read_lit(TomlTable& strobe, int channels, CoreConfig& core) {
    std::vector<double> lit{0};
    strobe.numbers("lit", lit, 1, 32);
    core.strobe_channels = 0;
    for (const double channel : lit) {
        if (channel < 0 || channel >= channels || channel != std::floor(channel)) {
            strobe.problem("lit", "names a channel that does not exist", "use 0 to strobe.channels less one");
            continue;
        }
        core.strobe_channels |= 1U << static_cast<unsigned>(channel);
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
    bool by_line = true;
    StrobeController controller;
    drivers::GardasoftStrobeOptions& gardasoft = controller.gardasoft;
    read_controller(strobe, backend == Backend::gardasoft, gardasoft, by_line);
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
        value.channels = described_channels(strobe, channels, value.channels);
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
    read_lit(strobe, value.channels, core);
    if (value.gpio.empty() && !value.controller) return check_light(strobe, core, value.limits);
    for (std::size_t k = 0; k < channels.size(); ++k) {
        if (((core.strobe_channels >> k) & 1U) != 0) check_light(channels[k], core, limits[k]);
    }
}

}  // namespace hord::firmware
