#include "firmware/devices/device_factory.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "common/assign.h"
#include "drivers/camera_process/camera_part_sensor.h"
#include "drivers/camera_process/camera_strobe.h"
#include "drivers/files/recorded_frames.h"
#include "drivers/gardasoft/gardasoft_strobe.h"
#include "drivers/genicam/genicam_sensor.h"
#include "drivers/gpio/gpio_part_sensor.h"
#include "drivers/gpio/gpio_strobe.h"
#include "drivers/libcamera/libcamera_sensor.h"
#include "drivers/modbus/modbus_rejector.h"
#include "drivers/v4l2/v4l2_sensor.h"
#include "firmware/core/faults.h"
#include "firmware/devices/expected_frames.h"
#include "hal_sim/cell/cell.h"
#include "hal_sim/cell/production.h"
#include "hal_sim/cell/rendered_frames.h"
#include "hal_sim/coil_module/coil_module.h"
#include "hal_sim/optics/camera/telecentric.h"

namespace hord::firmware {
namespace {

// The simulated line's geometry follows the configuration's timing, so that one file sets station and line.
sim::CellOptions cell_options(const Config& config, const SimulationOptions& simulation) {
    const CoreConfig& core = config.core;
    sim::CellOptions options;
    options.seed = simulation.seed;
    const double rate = rate_of_line(core, simulation.parts_per_second);
    // A higher rate moves the belt faster; the parts' pitch stays.
    options.conveyor.speed_mm_s = std::max(options.conveyor.speed_mm_s, options.schedule.pitch_mm * rate);
    const double speed = options.conveyor.speed_mm_s;
    const auto travel_mm = [&](Duration time) { return speed * std::chrono::duration<double>(time).count(); };
    options.schedule.parts = simulation.parts;
    options.schedule.pitch_mm = speed / rate;
    options.schedule.part_length_mm = options.schedule.pitch_mm * 0.4;
    options.geometry.camera_mm = travel_mm(core.exposure_delay + core.strobe_delay + core.strobe / 2);
    options.geometry.ejector_mm = travel_mm(core.transport);
    options.geometry.exit_mm = options.geometry.ejector_mm + 100;
    if (core.by_encoder)
        options.part_sensor.encoder_counts_per_mm =
            static_cast<double>(core.transport_counts) / options.geometry.ejector_mm;
    options.sensor.buffers = std::max(
        options.sensor.buffers, config.inspection.threads + config.inspection.queue + 2);  // exposing, and read out
    options.strobe.limits = {config.strobe.limits.max_on, config.strobe.limits.min_rest, config.strobe.channels};
    options.strobe.nominal_pulse = core.strobe;
    options.rejector.permit_moves_belt = true;
    return options;
}

// The parts of the simulated line: those of the configured scene files, else drawn ones.
Result<sim::Production> parts_of_line(const Config& config, const SimulationOptions& simulation) {
    const InspectionConfig& inspection = config.inspection;
    if (!has_scene_files(config)) {
        sim::ProductionOptions production;
        production.clean = sim::line_lens(inspection.bins_i, inspection.bins_j);
        production.seed = simulation.seed;
        production.good_share = simulation.good_share;
        production.good_parts = production.of_each_defect = simulation.variety;
        if (simulation.all_defects) production.defects.assign(sim::kAllDefects.begin(), sim::kAllDefects.end());
        return sim::draw_production(production);
    }
    return configured_scenes(config, simulation.good_share);
}

// Whether any device is simulated: then a simulated cell moves the parts.
bool needs_cell(const Config& config) {
    return (simulated_devices(config, {}) & ~std::uint32_t{kFaultSensor}) != 0 ||
        std::holds_alternative<SimulatedSensor>(config.sensor);
}

class ChosenBackends final : public Backends {
  public:
    explicit ChosenBackends(hal::EventLoop& loop) : loop_(loop) {}

    Result<void> open_all(const Config& config, const SimulationOptions& simulation) {
        auto done = open_lights(config);
        if (done) done = open_camera(config, simulation);
        if (done) done = open_rejector(config, simulation);
        return done;
    }

    hal::PartSensor& part_sensor() override { return part_sensor_ ? *part_sensor_ : cell_->part_sensor(); }
    hal::Strobe& strobe() override { return strobe_ ? *strobe_ : cell_->strobe(); }
    hal::Sensor& sensor() override { return sensor_ ? *sensor_ : cell_->sensor(); }
    Result<std::string> describe_module() override {
        if (!modbus_) return fail(ErrorCode::unsupported, "the rejector is simulated", "nothing to do");
        return firmware::describe_module(loop_, modbus_options_);
    }
    hal::Rejector& rejector() override { return modbus_ ? static_cast<hal::Rejector&>(*modbus_) : cell_->rejector(); }

    void start_line() override {
        if (cell_ && !std::exchange(line_started_, true)) cell_->start();
    }
    void feed_line(bool on) override {
        if (cell_) cell_->world().feed(on);
    }

    void clear_line() override {
        if (cell_) cell_->world().take_off([](const sim::PartRecord&) { return true; });
    }

    void watch_line(std::function<void(const Fate&)> fate, std::function<void()> over) override {
        if (!cell_) return;
        sim::World::Watchers watchers;
        watchers.over = std::move(over);
        watchers.part_gone = [this, fate = std::move(fate)](const sim::PartRecord& part) {
            if (!fate) return;
            std::optional<bool> ejected;
            if (!modbus_ || module_) ejected = part.fate == sim::PartRecord::Fate::ejected;
            fate({part.arrived, rendered_ == nullptr ? std::string() : cell_->world().schedule().kinds[part.kind].name,
                  part.kind, ejected, part.fate == sim::PartRecord::Fate::removed});
        };
        cell_->watch(std::move(watchers));
    }

    Result<std::vector<float>> telecentric_view(std::size_t look) const override {
        if (!rendered_ || look >= rendered_->scenes().size()) {
            return fail(ErrorCode::unsupported, "there is no telecentric view of this part",
                        "only parts of the simulated line have one");
        }
        sim::Scene scene = rendered_->scenes()[look];
        scene.telecentric.width_px = scene.camera.extents.m;
        scene.telecentric.height_px = scene.camera.extents.n;
        scene.telecentric.field_mm = scene.camera.field_mm;
        auto picture = sim::render_telecentric(scene);
        if (!picture) return tl::unexpected(picture.error());
        return std::move(picture->light);
    }

  private:
    // Called before the other devices are opened: the lights are off from then on.
    Result<void> open_lights(const Config& config) {
        if (auto done = assign(strobe_, open_strobe(loop_, config)); !done) return done;
        return assign(part_sensor_, open_part_sensor(loop_, config));
    }

    // The sensor, and the simulated cell if any device is simulated.
    Result<void> open_camera(const Config& config, const SimulationOptions& simulation) {
        sim::CellOptions options = cell_options(config, simulation);
        sim::FrameSource* source = &tokens_;
        if (auto done = assign(sensor_, open_sensor(loop_, config, simulation.progress)); !done) return done;
        if (auto light = light_of_camera(loop_, config, sensor_.get())) strobe_ = std::move(light);
        if (auto barrier = barrier_of_camera(loop_, config, sensor_.get())) part_sensor_ = std::move(barrier);
        if (const auto* recorded = dynamic_cast<const drivers::RecordedFrames*>(sensor_.get()))
            options.schedule.parts = simulation.parts == 0
                ? recorded->count()
                : std::min<std::uint64_t>(simulation.parts, recorded->count());
        if (!sensor_) {
            auto drawn = parts_of_line(config, simulation);
            if (!drawn) return tl::unexpected(drawn.error());
            sim::RenderedFramesOptions rendering;
            rendering.seed = simulation.seed;
            rendering.progress = simulation.progress;
            // The cache knows scenes by name and pose, which is too little for files that people write.
            if (!has_scene_files(config)) rendering.cache = simulation.cache;
            if (auto done = assign(rendered_, sim::RenderedFrames::make(std::move(drawn->scenes), rendering)); !done)
                return done;
            options.schedule.kinds = std::move(drawn->kinds);
            source = rendered_.get();
        }
        if (!needs_cell(config)) return {};
        return assign(cell_, sim::SimulatedCell::make(loop_, *source, options));
    }

    Result<void> open_rejector(const Config& config, const SimulationOptions& simulation) {
        const auto* configured = std::get_if<drivers::ModbusRejectorOptions>(&config.rejector);
        if (configured == nullptr && !simulation.own_coil_module) return {};
        drivers::ModbusRejectorOptions options =
            configured != nullptr ? *configured : std::get<SimulatedRejector>(config.rejector).module;
        if (simulation.own_coil_module) {
            if (auto done = assign(module_, sim::CoilModule::open(loop_, simulation.realtime)); !done) return done;
            // A plain module: pulses, watchdog and confirm sensor of the configured one are not simulated.
            options.address = {
                .host = "127.0.0.1", .port = module_->port(), .serial = {}, .unit = options.address.unit};
            options.map = {};
            options.module_pulse = options.watchdog = {};
            options.confirm_input = -1;
            // The coils move the simulated ejector and the belt. The belt moves while the run permit is up, as a PLC
            // moves it.
            if (cell_ && options.permit_coil >= 0) cell_->world().halt();
            module_->on_coil([this, ejector = options.ejector_coil, permit = options.permit_coil,
                              acts_at = !options.energise_to_pass](int moved, bool on, hal::TimePoint at) {
                if (!cell_) return;
                if (moved == ejector)
                    loop_.post([this, open = on == acts_at, at] { cell_->world().set_ejector(open, at); });
                if (moved == permit) loop_.post([this, on] { on ? cell_->world().resume() : cell_->world().halt(); });
            });
        }
        modbus_ = std::make_unique<drivers::ModbusRejector>(loop_, options);
        modbus_options_ = std::move(options);
        return {};
    }

    hal::EventLoop& loop_;
    drivers::ModbusRejectorOptions modbus_options_;
    // Destroyed in reverse order: the devices before what they use.
    sim::TokenFrames tokens_{{27, 27, 8}};
    std::unique_ptr<sim::RenderedFrames> rendered_;
    std::unique_ptr<sim::SimulatedCell> cell_;
    std::unique_ptr<hal::Sensor> sensor_;
    std::unique_ptr<hal::PartSensor> part_sensor_;
    std::unique_ptr<sim::CoilModule> module_;
    std::unique_ptr<drivers::ModbusRejector> modbus_;
    std::unique_ptr<hal::Strobe> strobe_;
    bool line_started_ = false;
};

}  // namespace

double rate_of_line(const CoreConfig& core, double wanted) {
    if (wanted > 0) return wanted;
    const auto seconds = [](Duration time) { return std::chrono::duration<double>(time).count(); };
    const double gap = core.by_encoder ? seconds(core.transport) * static_cast<double>(core.min_gap_counts) /
            static_cast<double>(core.transport_counts)
                                       : 0;
    return std::min(10.0, 0.5 / std::max(seconds(core.min_gap), gap));
}

std::uint32_t simulated_devices(const Config& config, const SimulationOptions& simulation) {
    const bool frames =
        std::holds_alternative<SimulatedSensor>(config.sensor) || std::holds_alternative<FrameFolder>(config.sensor);
    const bool rejector = simulation.own_coil_module || std::holds_alternative<SimulatedRejector>(config.rejector);
    return (std::holds_alternative<SimulatedPartSensor>(config.part_sensor) ? kFaultPartSensor : 0U) |
        (config.strobe.simulated() ? kFaultStrobe : 0U) | (frames ? kFaultSensor : 0U) |
        (rejector ? kFaultRejector : 0U);
}

Result<std::unique_ptr<hal::Strobe>> open_strobe(hal::EventLoop& loop, const Config& config) {
    if (config.strobe.controller) {
        const auto& [options, lines] = *config.strobe.controller;
        std::unique_ptr<hal::Strobe> trigger;
        std::vector<drivers::GpioStrobeChannel> inputs;
        for (std::size_t k = 0; k < lines.size(); ++k)
            inputs.push_back({lines[k], drivers::GardasoftStrobe::trigger_limits(options.channels[k], options)});
        if (!inputs.empty()) {
            if (auto done = assign(trigger, drivers::GpioStrobe::open(loop, inputs)); !done)
                return tl::unexpected(done.error());
        }
        return drivers::GardasoftStrobe::open(loop, options, std::move(trigger));
    }
    if (config.strobe.gpio.empty()) return nullptr;
    return drivers::GpioStrobe::open(loop, config.strobe.gpio);
}

std::unique_ptr<hal::Strobe> light_of_camera(hal::EventLoop& loop, const Config& config, hal::Sensor* sensor) {
    auto* const camera = dynamic_cast<drivers::CameraPortSensor*>(sensor);
    if (config.strobe.camera_line.empty() || camera == nullptr) return nullptr;
    return std::make_unique<drivers::CameraStrobe>(loop, *camera, config.strobe.limits, config.core.strobe);
}

std::unique_ptr<hal::PartSensor> barrier_of_camera(hal::EventLoop& loop, const Config& config, hal::Sensor* sensor) {
    auto* const camera = dynamic_cast<drivers::CameraPortSensor*>(sensor);
    const auto* const input = std::get_if<CameraInput>(&config.part_sensor);
    if (camera == nullptr || input == nullptr) return nullptr;
    return std::make_unique<drivers::CameraPartSensor>(loop, *camera, input->active_low);
}

Result<std::unique_ptr<hal::PartSensor>> open_part_sensor(hal::EventLoop& loop, const Config& config) {
    const auto* line = std::get_if<drivers::GpioPartSensorOptions>(&config.part_sensor);
    if (line == nullptr) return nullptr;
    return drivers::GpioPartSensor::open(loop, *line);
}

Result<std::unique_ptr<hal::Sensor>> open_sensor(hal::EventLoop& loop, const Config& config,
                                                 const std::function<void(double)>& progress) {
    if (const auto* recorded = std::get_if<FrameFolder>(&config.sensor)) {
        auto frames = drivers::RecordedFrames::open(loop, {recorded->folder}, progress, recorded->bits);
        if (!frames) return tl::unexpected(frames.error());
        if (auto fine = check_geometry((*frames)->noted(), config.inspection); !fine)
            return tl::unexpected(fine.error());
        return std::move(*frames);
    }
    if (const auto* video = std::get_if<drivers::V4l2SensorOptions>(&config.sensor))
        return drivers::V4l2Sensor::open(loop, *video);
    if (const auto* camera = std::get_if<drivers::LibcameraSensorOptions>(&config.sensor))
        return drivers::open_libcamera_sensor(loop, *camera);
    if (const auto* genicam = std::get_if<drivers::GenicamSensorOptions>(&config.sensor))
        return drivers::open_genicam_sensor(loop, *genicam);
    return nullptr;
}

Result<std::unique_ptr<Backends>> Backends::open(hal::EventLoop& loop, const Config& config,
                                                 const SimulationOptions& options) {
    auto chosen = std::make_unique<ChosenBackends>(loop);
    if (auto done = chosen->open_all(config, options); !done) return tl::unexpected(done.error());
    return chosen;
}

}  // namespace hord::firmware
