// A whole station, built from its configuration and run on the event loop, for hordd and `hordctl run`.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/event_loop/event_loop_sd.h"
#include "firmware/config/config.h"
#include "firmware/devices/active_calibration.h"
#include "firmware/devices/device_factory.h"
#include "firmware/modbus/rtu_server.h"
#include "firmware/modbus/tcp_server.h"
#include "firmware/monitoring/drift_monitor.h"
#include "firmware/monitoring/optics_monitor.h"
#include "firmware/plc/command_handler.h"
#include "firmware/plc/register_server_model.h"
#include "firmware/recipes/teach_in.h"
#include "firmware/service/station_files.h"
#include "firmware/station/empty_line_proof.h"
#include "firmware/station/state_lock.h"
#include "firmware/station/station.h"
#include "firmware/store/recorder/store_setup.h"

namespace hord::firmware {

// Called on the loop's thread (inspection: on the inspecting threads). All are optional.
struct ServiceWatchers {
    std::function<void(const PartResult&)> result;  // a part's final result
    std::function<void(State from, State to)> state;
    // The FaultBits `raised` were latched; before the change of state that they cause.
    std::function<void(std::uint32_t raised, const Snapshot&)> fault;
    std::function<void(const NumberedRecipe&)> recipe;  // another recipe is in use; not called for the first one
    std::function<void()> reload;                       // SIGHUP; empty: the signal stops the station
    std::function<void()> stopped_early;                // a signal ends the program, status 0, in open()
    std::function<void(const Error&)> trouble;          // to be logged once
    std::function<void(const Backends::Fate&)> fate;    // simulated line: ground truth of a part
    std::function<void()> line_over;  // simulated line: all parts came and left; their results may still come
    std::function<void(std::uint32_t part, const FrameView&, const algo::Inspection&)> inspection;
};

// Open listening sockets (systemd's socket activation); the service takes ownership. -1: it opens its own.
struct ListenSockets {
    int modbus = -1, modbus_read_only = -1;
};

class Service final : public StationObserver, public InspectionObserver {
  public:
    // Opens devices and ports; nothing runs yet. `files`: those of the configuration (read_station_files). A signal
    // that would stop run() ends the program while a simulated cell renders and while recorded frames are read. Fails
    // as the devices and servers do, and with busy, before anything is written, if another station uses the folder of
    // state or results. The destructor halts: lights off, outputs safe.
    static Result<std::unique_ptr<Service>> open(const Config& config, StationFiles files,
                                                 const SimulationOptions& simulation, ServiceWatchers watchers,
                                                 const ListenSockets& sockets = {});

    // Runs until stop(), SIGINT or SIGTERM. The belt of a simulated line moves while the station gives the run permit.
    // With a real rejector, whose outputs the simulation does not see, it moves from the first execution on, and after
    // `kLineWaits` in any state. A reset out of Error or Halted takes all parts off it, as a person at the line does.
    Result<void> run();
    static constexpr Duration kLineWaits = milliseconds(3000);

    void stop() { loop_->request_stop(); }  // any thread

    // After run(): halts (lights off, outputs safe), and every part on the line gets its result. Only close() and the
    // destructor may follow.
    void halt() { station_->end(); }

    // After run(): halts unless that was done, then writes what waits for the store. Blocks for some seconds at most if
    // the store fails. Returns what could not be stored: it is lost. Only the destructor may follow.
    std::vector<Error> close();

    // Loop thread. Applies another configuration at run time: access rules, the PLC's timeout, the folder of recipes,
    // and, while the station does not execute, the recipe. Returns the differing tables and keys that need a restart.
    // Fails if the new recipe cannot be used; then nothing has changed.
    Result<std::vector<std::string>> reload(const Config& next);

    // Loop thread, simulated line only. Acts as a person at a stopped line.
    void reset_line() { station_->request(Command::reset); }

    // Simulated line only: the telecentric picture of a part (Backends::telecentric_view). Any thread.
    [[nodiscard]] Result<std::vector<float>> telecentric_view(std::size_t look) const {
        return backends_->telecentric_view(look);
    }

    // Loop thread. Calls `all_here` there once every inspecting thread has answered; never if one hangs.
    void liveness_check(std::function<void()> all_here) { inspector_->liveness_check(std::move(all_here)); }

    [[nodiscard]] SdEventLoop& loop() { return *loop_; }
    [[nodiscard]] Snapshot snapshot() const { return station_->snapshot(); }                   // loop thread
    [[nodiscard]] const NumberedRecipe& recipe() const { return command_handler_->recipe(); }  // loop thread; in use
    [[nodiscard]] std::uint32_t simulated() const { return identity_.simulated; }  // devices, by their fault bits
    [[nodiscard]] std::string registers_address() const;                           // "127.0.0.1:1502"

  private:
    Service(const Config& config, StationFiles files, ServiceWatchers watchers, const ListenSockets& sockets)
        : config_(config), sockets_(sockets), watchers_(std::move(watchers)), grid_(std::move(files.calibration)),
          configured_(std::move(files.recipe)) {}

    // service.cpp
    Result<void> open_all(const SimulationOptions& simulation);
    Result<void> lock_folders();
    void prepare_registers();
    Result<void> open_servers();
    void close_servers();
    Result<algo::Extents> open_grid(const hal::SensorFormat& format);
    Result<void> open_inspector(const NumberedRecipe& recipe, const algo::Extents& extents);
    void connect(NumberedRecipe recipe, const algo::Extents& extents);
    bool withdraw_proof();
    void prove_empty_line();

    // service_recipe.cpp
    NumberedRecipe first_recipe(const algo::Extents& extents, int bits);
    NumberedRecipe take_kept(RememberedRecipe kept, NumberedRecipe configured, const std::filesystem::path& file);
    void kept_is_lost(const Error& why, const NumberedRecipe& instead);
    Result<void> keep_recipe(const NumberedRecipe& recipe);

    // service_events.cpp
    void publish();
    void publish_again();         // schedules itself again
    void publish_health_again();  // schedules itself again
    void on_result(const PartResult& result) override;
    void on_fault(std::uint32_t raised, const Snapshot& now) override;
    void on_state(State from, State to) override;
    void on_step(State before, const Event& event) override;
    void on_trouble(const Error& error) override;
    void on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection) override;
    void on_bounded(bool out_of_time);  // an inspection reached a limit
    void on_drift();
    void on_optics();
    void report_faults();
    void publish_calibration();
    void on_recipe(const NumberedRecipe& recipe);

    // Destroyed in reverse order: servers first, then the station (halts), the devices, the loop.
    Config config_;
    StateLock state_lock_, store_lock_;  // of their folders
    ListenSockets sockets_;
    ServiceWatchers watchers_;
    std::unique_ptr<SdEventLoop> loop_;
    std::unique_ptr<store::StationRecorder> recorder_;
    std::unique_ptr<Backends> backends_;
    std::unique_ptr<DriftMonitor> drift_;    // fed by the inspecting threads
    std::unique_ptr<OpticsMonitor> optics_;  // fed by the inspecting threads
    std::unique_ptr<LineTeachIn> teach_in_;  // fed by the inspecting threads; null: no state folder
    CalibrationReport calibration_;
    std::optional<ActiveCalibration> grid_;  // empty: macro-pixel frames
    std::uint32_t store_faults_ = 0, drift_fault_ = 0, optics_faults_ = 0, recipe_fault_ = 0;
    std::unique_ptr<Inspector> inspector_;
    std::unique_ptr<Station> station_;
    std::optional<CommandHandler> command_handler_;
    std::optional<PlcInterface> plc_interface_;
    std::optional<RegisterServerModel> registers_;
    std::unique_ptr<modbus::Server> server_, read_only_server_;
    std::unique_ptr<modbus::RtuServer> serial_server_;

    EmptyLineProof empty_line_{{}};
    bool proof_withdrawn_ = false;
    std::vector<PartResult> unpublished_;
    HealthReport health_{.frames_lost = 0, .frames_corrupt = 0, .bounded = 0};
    std::optional<Duration> bounded_told_;  // since opened_at_: when the journal was last told of a limit
    hal::TimePoint opened_at_{};
    NumberedRecipe configured_;            // at the start
    std::uint32_t configured_recipe_ = 0;  // CRC-32
    StationIdentity identity_;
};

}  // namespace hord::firmware
