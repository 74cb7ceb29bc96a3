#include "firmware/config/device_sections.h"
#include "firmware/config/shared_keys.h"

namespace hord::firmware {

using common::TomlTable;

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
