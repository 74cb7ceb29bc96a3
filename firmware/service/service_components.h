// The parts of a Service and how they are connected. Private to service*.cpp.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "firmware/devices/active_calibration.h"
#include "firmware/modbus/rtu_server.h"
#include "firmware/modbus/tcp_server.h"
#include "firmware/monitoring/drift_monitor.h"
#include "firmware/monitoring/optics_monitor.h"
#include "firmware/plc/command_handler.h"
#include "firmware/plc/register_server_model.h"
#include "firmware/recipes/teach_in.h"
#include "firmware/service/service.h"
#include "firmware/station/line_occupancy_marker.h"
#include "firmware/store/recorder/store_setup.h"

namespace hord::firmware {

// Members are destroyed in reverse order: servers first, then the station (halts), the devices, the loop.
struct Service::Components final : StationObserver, InspectionObserver {
    Config config;
    ListenSockets sockets;
    ServiceWatchers watchers;
    std::unique_ptr<SdEventLoop> loop;
    std::unique_ptr<store::StationRecorder> recorder;
    std::unique_ptr<Backends> backends;
    std::unique_ptr<DriftMonitor> drift;    // fed by the inspecting threads
    std::unique_ptr<OpticsMonitor> optics;  // fed by the inspecting threads
    std::unique_ptr<LineTeachIn> teach_in;  // fed by the inspecting threads; null: no state folder
    CalibrationReport calibration;
    std::optional<ActiveCalibration> grid;  // empty: macro-pixel frames
    std::uint32_t store_faults = 0, drift_fault = 0, optics_faults = 0;
    std::unique_ptr<Inspector> inspector;
    std::unique_ptr<Station> station;
    std::optional<CommandHandler> command_handler;
    std::optional<PlcInterface> plc_interface;
    std::optional<RegisterServerModel> registers;
    std::unique_ptr<modbus::Server> server, read_only_server;
    std::unique_ptr<modbus::RtuServer> serial_server;

    OccupancyMarker occupancy_marker{{}};
    std::vector<PartResult> unpublished;
    HealthReport health;
    hal::TimePoint opened_at{};
    std::uint32_t configured_recipe = 0;  // CRC-32
    std::uint32_t boot_id = 0;

    // service_events.cpp
    void publish();
    void publish_again();         // repeats itself
    void publish_health_again();  // repeats itself

    void on_result(const PartResult& result) override;
    void on_state(State from, State to) override;
    void on_trouble(const Error& error) override;
    void on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection) override;
    void on_drift();
    void on_optics();
    void report_faults();
    void publish_calibration();
    void on_recipe(const NumberedRecipe& recipe);

    // service.cpp
    Result<void> open(const SimulationOptions& simulation);
    Result<void> open_servers();
    Result<NumberedRecipe> first_recipe();
    Result<algo::Extents> open_grid(const hal::SensorFormat& format);
    Result<void> open_inspector(const NumberedRecipe& recipe);
    void connect(NumberedRecipe recipe);
    Result<std::vector<std::string>> reload(const Config& next);  // service_reload.cpp
};

}  // namespace hord::firmware
