// A line in virtual time: the real station, the simulated cell, a simulated operator, and the omniscient observer.
//
// The station's process may die at any point. It is started again, as by systemd, and then does not know what is on the
// line. The person who resets after line stop takes every part off the belt.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "firmware/station/station.h"
#include "hal_sim/cell/cell.h"
#include "lab/soak/coverage.h"
#include "lab/soak/device_proxies.h"
#include "lab/soak/invariants.h"
#include "lab/soak/ordered_stops.h"
#include "lab/soak/plc_simulator.h"
#include "lab/soak/store_observer.h"
#include "lab/stand_in/stand_in_inspector.h"
#include "lab/virtual_time/virtual_time.h"

namespace hord::lab {

using namespace firmware;

struct LineOptions {
    CoreConfig core;
    sim::CellOptions cell;

    // The stand-in inspector judges by the token in the frame, after this time.
    Duration inspection = milliseconds(20);
    int queue = 4;

    Duration reset_after = milliseconds(500);  // from an error until a person resets the station
    // From the death of the process until the rejector's module drops permit and outputs.
    Duration module_watchdog = milliseconds(50);

    // Optional, in place of tokens: a frame source, which outlives the line, and the function that judges its frames. A
    // bad part that this function passes is no violation.
    sim::FrameSource* frames = nullptr;
    InspectFunction judge;
};

// A line of 10 parts a second on a belt of 500 mm/s, camera 100 mm and ejector 400 mm behind the part sensor. The belt
// stops when the run permit drops. One part in ten is bad.
LineOptions timed_line(std::uint64_t seed, std::uint64_t parts);
LineOptions encoder_line(std::uint64_t seed, std::uint64_t parts);  // with an encoder; the belt speed jitters

class SimulatedLine final : public StationObserver {
  public:
    static Result<std::unique_ptr<SimulatedLine>> make(const LineOptions& options);
    ~SimulatedLine() override;

    // Runs until every part is gone and the line is empty. False when that takes longer than twenty times the belt's
    // time.
    bool run();

    [[nodiscard]] Invariants& invariants() { return *invariants_; }
    [[nodiscard]] const Coverage& coverage() const { return coverage_; }
    [[nodiscard]] Snapshot snapshot() const { return process_ ? process_->station->snapshot() : Snapshot{}; }
    [[nodiscard]] sim::SimulatedCell& cell() { return *cell_; }
    [[nodiscard]] VirtualTime& loop() { return loop_; }
    [[nodiscard]] Station& station() { return *process_->station; }  // while a process runs
    [[nodiscard]] const StoreObserver& store_observer() const { return *store_observer_; }
    [[nodiscard]] std::uint64_t resets() const { return resets_; }
    [[nodiscard]] std::uint64_t line_stops() const { return line_stops_; }
    [[nodiscard]] std::uint64_t processes() const { return processes_; }
    [[nodiscard]] const std::vector<PartResult>& results() const { return results_; }
    void keep_results(bool keep) { keep_results_ = keep; }

  private:
    class ObservedInspector;
    struct Process {  // destroyed in reverse order
        std::unique_ptr<DeviceProxies> proxies;
        std::unique_ptr<Inspector> inspector;
        std::unique_ptr<Station> station;
        std::unique_ptr<PlcEndpoint> plc_endpoint;
        bool alive = true;  // false: cut off, to be destroyed
    };
    explicit SimulatedLine(const LineOptions& options) : options_(options) {}
    Result<void> assemble();
    Result<void> start_process(bool line_unknown);
    void end_process(Duration down_for, bool line_unknown);
    void restart_cleanly();
    void plc_cycle();
    void take_parts_off();
    void publish_soon();
    void unplug_something(Duration amount);
    void part_arrives(const sim::PartRecord& part);
    [[nodiscard]] StandInAnswer judge(std::uint32_t part, const hal::FrameLease& frame);
    [[nodiscard]] Judged judge_by_token(const hal::FrameLease& frame) const;
    void schedule_reset();
    void reset_line();
    void watch_line_stop();
    void on_result(const PartResult& result) override;
    void on_fault(std::uint32_t raised, const Snapshot& now) override;
    void on_state(State from, State to) override;
    void on_step(State before, const Event& event) override;
    [[nodiscard]] bool alive() const { return process_ && process_->alive; }

    LineOptions options_;
    VirtualTime loop_;
    sim::TokenFrames tokens_{{5, 5, 8}};
    Coverage coverage_;
    std::unique_ptr<sim::SimulatedCell> cell_;
    std::unique_ptr<Invariants> invariants_;
    std::optional<StoreObserver> store_observer_;
    std::optional<PlcSimulator> plc_;
    std::optional<OrderedStops> orders_;
    std::optional<Process> process_;
    bool line_started_ = false;
    bool reset_scheduled_ = false;
    bool was_stopped_ = false;
    bool keep_results_ = false;
    hal::TimePoint hangs_until_{};
    std::uint64_t resets_ = 0, line_stops_ = 0, processes_ = 0, drawn_ = 0;
    std::vector<PartResult> results_;
};

}  // namespace hord::lab
