// The simulated cell: world and devices, assembled from one struct of options.
//
//     sim::TokenFrames frames({27, 27, 8});                       // or sim::RenderedFrames
//     auto cell = sim::SimulatedCell::make(loop, frames, options);  // any event loop: virtual or real time
//     station.start((*cell)->part_sensor(), (*cell)->strobe(), (*cell)->sensor(), (*cell)->rejector());
//     (*cell)->start();                                           // the belt moves, parts come
#pragma once

#include <memory>
#include <vector>

#include "drivers/hal/event_loop.h"
#include "hal_sim/devices/sim_part_sensor.h"
#include "hal_sim/devices/sim_rejector.h"
#include "hal_sim/devices/sim_sensor.h"
#include "hal_sim/devices/sim_strobe.h"
#include "hal_sim/world/fault_injection.h"
#include "hal_sim/world/frame_source.h"
#include "hal_sim/world/world.h"

namespace hord::sim {

struct CellOptions {
    std::uint64_t seed = 1;
    ConveyorOptions conveyor;
    ScheduleOptions schedule;
    GeometryOptions geometry;
    PartSensorOptions part_sensor;
    StrobeOptions strobe;
    SensorOptions sensor;
    RejectorOptions rejector;
    std::vector<InjectionRule> faults;

    // The delays for a station's configuration: from the arrival edge to the part centred before camera and ejector.
    [[nodiscard]] hal::Duration camera_delay() const { return travel(geometry.camera_mm); }
    [[nodiscard]] hal::Duration ejector_delay() const { return travel(geometry.ejector_mm); }
    [[nodiscard]] hal::Duration travel(double mm) const {
        return hal::Duration(static_cast<hal::Duration::rep>(mm / conveyor.speed_mm_s * 1e9));
    }
};

class SimulatedCell {
  public:
    // `loop` and `frames` outlive the cell. Fails with invalid_argument, naming every impossible option.
    static Result<std::unique_ptr<SimulatedCell>> make(hal::EventLoop& loop, FrameSource& frames,
                                                       const CellOptions& options);

    // Starts the belt. Arm the station first if it is to see the first part.
    void start() { world_.start(); }
    [[nodiscard]] bool finished() const { return world_.finished(); }

    [[nodiscard]] hal::PartSensor& part_sensor() { return part_sensor_; }
    void unplug_part_sensor(hal::Duration gone_for) { part_sensor_.unplug(gone_for); }
    [[nodiscard]] SimStrobe& strobe() { return strobe_; }
    [[nodiscard]] SimSensor& sensor() { return sensor_; }
    [[nodiscard]] SimRejector& rejector() { return rejector_; }  // or use a real one that calls world().set_ejector()

    [[nodiscard]] World& world() { return world_; }
    [[nodiscard]] InjectionPlan& faults() { return faults_; }

    // Observers in addition to the cell's own.
    void watch(World::Watchers watchers);

  private:
    SimulatedCell(hal::EventLoop& loop, FrameSource& frames, const CellOptions& options);

    InjectionPlan faults_;
    World world_;
    SimPartSensor part_sensor_;
    SimStrobe strobe_;
    SimSensor sensor_;
    SimRejector rejector_;
};

}  // namespace hord::sim
