// A whole line in virtual time: the real station, the simulated cell, a person who resets, and the omniscient observer.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "firmware/soak/invariants.h"
#include "firmware/station.h"
#include "hal_sim/cell/cell.h"
#include "hal_sim/cell/virtual_time.h"

namespace hord::firmware {

struct LineOptions {
    CoreConfig core;
    sim::CellOptions cell;

    // The stand-in inspector judges by the token in the frame, after this time; parts in [slow_first, slow_last] take longer.
    Duration inspection = milliseconds(20);
    Duration slow_inspection = milliseconds(1000);
    std::uint32_t slow_first = 0, slow_last = 0;
    int queue = 4;

    Duration reset_after = milliseconds(500);  // a person resets the station so long after an error

    // In place of tokens and stand-in: a frame source, and an inspector for its frames. The source outlives the line.
    sim::FrameSource* frames = nullptr;
    std::function<Result<std::unique_ptr<Inspector>>(hal::EventLoop&)> inspector;
};

// A line of 10 parts a second on a belt of 500 mm/s, camera 100 mm and ejector 400 mm behind the part sensor. The belt stops
// when the run permit drops. One part in ten is bad.
LineOptions timed_line(std::uint64_t seed, std::uint64_t parts);
LineOptions encoder_line(std::uint64_t seed, std::uint64_t parts);  // followed by an encoder; the belt jitters

class SimulatedLine final : public StationObserver {
  public:
    static Result<std::unique_ptr<SimulatedLine>> make(const LineOptions& options);
    ~SimulatedLine() override;

    // Until every part is gone and the line is empty; false when that takes longer than twenty times the belt's time.
    bool run();

    [[nodiscard]] const Invariants& invariants() const { return *invariants_; }
    [[nodiscard]] Snapshot snapshot() const { return station_->snapshot(); }
    [[nodiscard]] sim::SimulatedCell& cell() { return *cell_; }
    [[nodiscard]] sim::VirtualTime& loop() { return loop_; }
    [[nodiscard]] Station& station() { return *station_; }
    [[nodiscard]] std::uint64_t resets() const { return resets_; }
    [[nodiscard]] std::uint64_t line_stops() const { return line_stops_; }
    [[nodiscard]] std::uint32_t slow_inspections() const { return slow_inspections_; }
    [[nodiscard]] const std::vector<PartResult>& kept() const { return kept_; }
    void keep_results(bool keep) { keep_ = keep; }

  private:
    class Witness;
    explicit SimulatedLine(const LineOptions& options) : options_(options) {}
    Result<void> assemble();
    StandInAnswer judge(std::uint32_t part, const hal::FrameLease& frame);
    void look_after_the_line();
    void watch_line_stop();
    void on_result(const PartResult& result) override;
    void on_state(State from, State to) override;

    LineOptions options_;
    sim::VirtualTime loop_;
    sim::TokenFrames tokens_{{27, 27, 8}};
    std::unique_ptr<sim::SimulatedCell> cell_;
    std::unique_ptr<Invariants> invariants_;
    std::unique_ptr<Inspector> inspector_;
    std::unique_ptr<Station> station_;
    bool person_is_coming_ = false;
    bool was_stopped_ = false;
    bool keep_ = false;
    std::uint64_t resets_ = 0, line_stops_ = 0;
    std::uint32_t slow_inspections_ = 0;
    std::vector<PartResult> kept_;
};

}  // namespace hord::firmware
