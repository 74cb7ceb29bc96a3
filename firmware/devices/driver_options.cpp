#include "firmware/devices/driver_options.h"

#include <algorithm>

#include <fmt/format.h>

namespace hord::firmware {

drivers::ModbusRejectorOptions rejector_options(const ModbusRejector& wanted) {
    drivers::ModbusRejectorOptions options;
    options.address.host = wanted.host;
    options.address.port = wanted.port;
    if (!wanted.device.empty())
        options.address.serial = drivers::SerialSettings{wanted.device, wanted.baud, wanted.parity, wanted.rs485};
    options.address.unit = wanted.unit;
    options.map = wanted.map;
    options.ejector_coil = wanted.reject_coil;
    options.permit_coil = wanted.run_permit_coil;
    options.energise_to_pass = wanted.energise_to_pass;
    options.module_pulse = wanted.module_pulse;
    options.confirm_input = wanted.confirm_input;
    options.confirm_active_low = wanted.confirm_active_low;
    options.confirm_within = wanted.confirm_within;
    options.watchdog = wanted.watchdog;
    options.response_timeout = wanted.response_timeout;
    return options;
}

drivers::GpioLine gpio_line(const GpioLineName& name) {
    return {name.chip, name.line, name.active_low, static_cast<drivers::GpioLine::Bias>(name.bias)};
}

std::vector<drivers::GpioStrobeChannel> strobe_channels(const StrobeConfig& wanted) {
    std::vector<drivers::GpioStrobeChannel> channels;
    for (const StrobeChannel& channel : wanted.gpio) {
        channels.push_back({gpio_line(channel.line), {channel.max_on, channel.min_rest, channel.max_duty}});
    }
    return channels;
}

drivers::GpioPartSensorOptions part_sensor_options(const GpioPartSensorLine& wanted) {
    drivers::GpioPartSensorOptions options;
    options.line = gpio_line(wanted.line);
    options.debounce = wanted.debounce;
    if (wanted.encoder) options.encoder = gpio_line(*wanted.encoder);
    options.encoder_every = wanted.encoder_every;
    return options;
}

drivers::V4l2SensorOptions video_options(const VideoSensor& wanted) {
    drivers::V4l2SensorOptions options;
    options.device = wanted.device;
    options.width_px = wanted.width_px;
    options.height_px = wanted.height_px;
    options.bits = wanted.bits;
    options.buffers = wanted.buffers;
    options.controls = wanted.controls;
    return options;
}

drivers::CameraRequest camera_request(const CameraSensor& wanted) {
    return {wanted.camera,  wanted.width_px, wanted.height_px, wanted.bits,
            wanted.buffers, wanted.green,    wanted.controls};
}

namespace {

// By function 43/14, or the registers in which its maker keeps it.
std::string identity_of(drivers::CoilLink& link, const drivers::ModbusRejectorOptions& options) {
    const hal::ModuleMap& map = options.map;
    if (map.name_register >= 0 && map.name_words == 0) {
        const auto number = link.read_register(map.name_register, options.response_timeout);
        return number ? map.name_prefix + std::to_string(*number)
                      : std::string("a module that does not say what it is");
    }
    if (map.name_register >= 0) {
        const auto words = link.read_input_registers(map.name_register, map.name_words, options.response_timeout);
        if (!words) return "a module that does not say what it is";
        std::string text;
        for (const std::uint16_t word : *words) {
            for (const int letter : {word >> 8, word & 0xFF}) {
                if (letter >= 0x20 && letter < 0x7F) text += static_cast<char>(letter);
            }
        }
        return text;
    }
    return link.identify(options.response_timeout).value_or("a module that does not say what it is");
}

}  // namespace

Result<std::string> ask_module(const hal::Clock& clock, const drivers::ModbusRejectorOptions& options) {
    drivers::CoilLink link(clock, options.address);
    if (auto connected = link.connect(options.response_timeout); !connected) return tl::unexpected(connected.error());
    std::string outputs;
    const auto look = [&](const char* what, int coil) -> Result<void> {
        if (coil < 0) return {};
        const auto value = link.read(coil + options.map.read_back_offset, options.response_timeout);
        if (!value) return tl::unexpected(value.error());
        outputs += fmt::format("; {} (coil {}) is {}", what, coil, *value ? 1 : 0);
        return {};
    };
    if (auto done = look("ejector", options.ejector_coil); !done) return tl::unexpected(done.error());
    if (auto done = look("run permit", options.permit_coil); !done) return tl::unexpected(done.error());
    if (options.confirm_input >= 0) {
        const auto value = link.read_input(options.confirm_input, options.response_timeout);
        if (!value) return tl::unexpected(value.error());
        outputs += fmt::format("; confirm sensor (input {}) is {}", options.confirm_input, *value ? 1 : 0);
    }
    return identity_of(link, options) + outputs;
}

}  // namespace hord::firmware
