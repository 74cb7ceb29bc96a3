#include "firmware/devices/device_probe.h"

#include <utility>

#include <fmt/format.h>

#include "common/assign.h"
#include "drivers/gardasoft/gardasoft_strobe.h"
#include "drivers/gpio/gpio_lines.h"
#include "drivers/libcamera/libcamera_sensor.h"
#include "drivers/modbus/modbus_rejector.h"

namespace hord::firmware {
namespace {

struct Devices {
    std::unique_ptr<Backends> simulated;
    std::unique_ptr<hal::Sensor> sensor;
    std::unique_ptr<hal::PartSensor> part_sensor;  // before the sensor that it hears by
    std::unique_ptr<hal::Rejector> rejector;
    std::unique_ptr<hal::Strobe> strobe;
};

std::string name_of(const drivers::GpioLine& line) { return line.chip + " line " + line.line; }

// Stores the opened device, or the error.
template <class Device, class Opened>
void store(DeviceUnderTest<Device>& under_test, std::unique_ptr<Device>& keep, Opened opened) {
    if (!opened) {
        under_test.device = tl::unexpected(opened.error());
        return;
    }
    keep = std::move(*opened);
    under_test.device = keep.get();
}

// What the configuration calls a strobe controller, and what it says of itself.
std::string name_of(const StrobeController& controller) {
    const drivers::GardasoftStrobeOptions& options = controller.gardasoft;
    std::string name = options.device.empty() ? fmt::format("{}:{}", options.host, options.port) : options.device;
    if (const auto says = drivers::identify(options)) name += ", " + *says;
    for (const drivers::GpioLine& line : controller.triggers) name += ", trigger " + name_of(line);
    return name;
}

void probe_lines(hal::EventLoop& loop, const Config& config, Devices& devices, CellUnderTest& cell) {
    if (config.strobe.controller) {
        cell.strobe.name = name_of(*config.strobe.controller);
        store(cell.strobe, devices.strobe, open_strobe(loop, config));
    }
    if (!config.strobe.gpio.empty()) {
        for (const drivers::GpioStrobeChannel& channel : config.strobe.gpio)
            cell.strobe.name += (cell.strobe.name.empty() ? "" : ", ") + name_of(channel.line);
        cell.strobe.name += " (libgpiod " + drivers::gpiod_version() + ")";
        store(cell.strobe, devices.strobe, open_strobe(loop, config));
    }
    if (const auto* line = std::get_if<drivers::GpioPartSensorOptions>(&config.part_sensor)) {
        cell.part_sensor.name = name_of(line->line) + (line->encoder ? ", encoder " + name_of(*line->encoder) : "");
        cell.encoder = line->encoder.has_value();
        store(cell.part_sensor, devices.part_sensor, open_part_sensor(loop, config));
    }
}

void probe_sensor(hal::EventLoop& loop, const Config& config, Devices& devices, CellUnderTest& cell) {
    if (const auto* video = std::get_if<drivers::V4l2SensorOptions>(&config.sensor)) {
        cell.sensor.name = video->device;
    } else if (const auto* camera = std::get_if<drivers::LibcameraSensorOptions>(&config.sensor)) {
        cell.sensor.name = (camera->camera.empty() ? "the only camera" : camera->camera) + " (libcamera " +
            drivers::libcamera_version() + ")";
    } else if (const auto* genicam = std::get_if<drivers::GenicamSensorOptions>(&config.sensor)) {
        cell.sensor.name = (genicam->camera.empty() ? "the only camera" : genicam->camera) + " (GenICam)";
    } else if (const auto* recorded = std::get_if<FrameFolder>(&config.sensor)) {
        cell.sensor.name = "recorded frames in " + recorded->folder.string();
    } else {
        return;
    }
    store(cell.sensor, devices.sensor, open_sensor(loop, config));
    if (const auto* input = std::get_if<CameraInput>(&config.part_sensor)) {
        cell.part_sensor.name = "the camera's " + input->line;
        cell.camera_hears = cell.sensor.device.has_value();
        devices.part_sensor = barrier_of_camera(loop, config, devices.sensor.get());
        cell.part_sensor.device = devices.part_sensor.get();
        if (!cell.sensor.device) cell.part_sensor.device = tl::unexpected(cell.sensor.device.error());
    }
    if (config.strobe.camera_line.empty()) return;
    cell.strobe.name = "the camera's " + config.strobe.camera_line;
    cell.camera_lights = true;
    if (!cell.sensor.device) {
        cell.strobe.device = tl::unexpected(cell.sensor.device.error());
        return;
    }
    devices.strobe = light_of_camera(loop, config, devices.sensor.get());
    cell.strobe.device = devices.strobe.get();
}

void probe_rejector(hal::EventLoop& loop, const Config& config, Devices& devices, CellUnderTest& cell) {
    const auto* options = std::get_if<drivers::ModbusRejectorOptions>(&config.rejector);
    if (options == nullptr) return;
    const drivers::ModuleAddress& at = options->address;
    cell.rejector.name = at.serial ? fmt::format("{} unit {}", at.serial->device, at.unit)
                                   : fmt::format("{}:{} unit {}", at.host, at.port, at.unit);
    devices.rejector = std::make_unique<drivers::ModbusRejector>(loop, *options);
    cell.rejector.device = devices.rejector.get();
    cell.ask_module = [&loop, options = *options] { return describe_module(loop, options); };
}

Result<void> open_simulated(hal::EventLoop& loop, Config config, Devices& devices, CellUnderTest& cell) {
    config.sensor = SimulatedSensor{};
    config.part_sensor = SimulatedPartSensor{};
    config.strobe.gpio.clear();
    config.strobe.controller.reset();
    config.strobe.camera_line.clear();
    config.rejector = SimulatedRejector{};
    SimulationOptions options;
    options.variety = 1;
    options.own_coil_module = true;
    if (auto done = assign(devices.simulated, Backends::open(loop, config, options)); !done) return done;
    Backends& all = *devices.simulated;
    cell.part_sensor = {&all.part_sensor(), "simulated"};
    cell.strobe = {&all.strobe(), "simulated"};
    cell.sensor = {&all.sensor(), "simulated"};
    cell.rejector = {&all.rejector(), "simulated module on loopback"};
    cell.ask_module = [&all] { return all.describe_module(); };
    return {};
}

}  // namespace

Result<EachDevice> open_each_device(hal::EventLoop& loop, const Config& config, const algo::Recipe& recipe,
                                    const std::optional<ActiveCalibration>& calibration, bool simulate) {
    EachDevice each;
    each.cell.core = config.core;
    each.cell.bins_i = config.inspection.bins_i;
    each.cell.bins_j = config.inspection.bins_j;
    each.cell.recipe = recipe;
    auto devices = std::make_shared<Devices>();
    if (simulate) {
        if (auto opened = open_simulated(loop, config, *devices, each.cell); !opened)
            return tl::unexpected(opened.error());
    } else {
        probe_lines(loop, config, *devices, each.cell);
        probe_sensor(loop, config, *devices, each.cell);
        probe_rejector(loop, config, *devices, each.cell);
        if (calibration && each.cell.sensor.device && *each.cell.sensor.device != nullptr) {
            if (auto fits = check_calibration(*calibration, {}, (*each.cell.sensor.device)->format()); !fits)
                return tl::unexpected(fits.error());
            each.cell.decoder = *calibration->decoder;
        }
    }
    each.keep = std::move(devices);
    return each;
}

}  // namespace hord::firmware
