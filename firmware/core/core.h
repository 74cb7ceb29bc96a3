// The station core: a pure state machine, (state, event, now) -> actions.
//
// It owns no descriptor, thread, clock or file and allocates nothing. It is deterministic: the same events at the same
// times give the same actions. The station (firmware/station/station.h) brings events and carries out actions, in the
// service and in simulation.
//
// Guarantees for any sequence of events:
//   - every part that the part sensor reports gets exactly one verdict, at its deadline at the latest;
//   - only a part whose own frame, lit by its own strobe, was judged good in time passes;
//   - every other part is commanded to be rejected once; line stop is raised unless the rejection is confirmed in time;
//   - an edge counts at its own time, however late it is told: a part that came before the start is not inspected, and
//     without an encoder one that came before the reset of a line stop is off the line (fault part-sensor, no stop).
//
// Files: core.cpp commands, devices, faults; arrival.cpp from edge to exposure; matching.cpp assigns frames, light and
// judgements to parts; rejection.cpp deadlines, reject commands and reports.
#pragma once

#include "firmware/core/actions.h"
#include "firmware/core/conveyor.h"
#include "firmware/core/core_config.h"
#include "firmware/core/events.h"
#include "firmware/core/line.h"
#include "firmware/core/states.h"
#include "firmware/core/station_types.h"

namespace hord::firmware {

// Outcome of a command. For an event that is not a command: always done.
enum class Answer : std::uint8_t {
    done,
    not_in_this_state,
    device_down,  // arm: a device is lost or not yet open
    plc_lost,     // start: the PLC's heartbeat is missing, and the policy is stop
    not_yet,      // arm: the ejector may still execute an earlier command; reset: line stop was not up for kMinLineStop
};

class Core {
  public:
    // Precondition: problems(config) is empty.
    explicit Core(const CoreConfig& config) : config_(config) {}

    // Replaces the contents of `actions`. A `now` earlier than that of the last step is replaced by it.
    Answer step(const Event& event, TimePoint now, Actions& actions);

    // The process ends: from the next step on, which halts, every part without a result gets it. Its rejection failed.
    void end() { ends_ = true; }

    // When the next Tick is due unless another event comes first. In the past: at once.
    [[nodiscard]] TimePoint next_wake() const { return next_wake_; }

    [[nodiscard]] State state() const { return state_; }
    [[nodiscard]] bool all_devices_up() const { return up_ == kDeviceFaults; }
    [[nodiscard]] Snapshot snapshot() const;
    [[nodiscard]] bool line_stop() const { return line_stop_; }
    [[nodiscard]] std::uint32_t faults_latched() const { return faults_latched_; }
    [[nodiscard]] bool run_permit() const { return run_permit_; }
    [[nodiscard]] const Counters& counters() const { return counters_; }
    [[nodiscard]] const CoreConfig& config() const { return config_; }
    [[nodiscard]] const Line& line() const { return line_; }

  private:
    // core.cpp
    void on(const Tick&) {}
    void on(Command command);
    void on(const DeviceUp& event);
    void on(const DeviceLost& event);
    void on(const PlcLost&);
    void on(const PlcBack&) { plc_lost_ = false; }
    void on(const OutsideFaults& event);
    [[nodiscard]] bool without_plc(PlcPolicy policy) const { return plc_lost_ && config_.plc_policy == policy; }
    void on(const LineUnknown&) { stop_the_line({LineStopCause::line_unknown}); }
    void go(Cause cause);
    void carry_out(Command command, State from);
    void flush(PartReason reason);
    void reset_faults();
    [[nodiscard]] bool accepting() const;
    [[nodiscard]] bool up(Device device) const { return (up_ & fault_of(device)) != 0; }
    [[nodiscard]] std::uint32_t active_faults() const;
    void fault(std::uint32_t bits);
    void keep_active(std::uint32_t bits);
    void stop_the_line(LineStop why);

    // arrival.cpp
    void on(const hal::PartEdge& edge);
    void on(const hal::EncoderReading& reading);
    [[nodiscard]] bool continues(const hal::PartEdge& edge);
    void arrive(const hal::PartEdge& edge, bool identity_certain);
    void part_was_there();
    void look_for_touching_parts(TimePoint at, std::int64_t counts);
    [[nodiscard]] bool belt_runs_since(TimePoint at) const;
    [[nodiscard]] bool looked_after_since(TimePoint at) const;
    [[nodiscard]] bool comes_too_close(TimePoint at, std::int64_t counts);
    [[nodiscard]] TimePoint expose_when_due(Part& part);
    void lose_permit();
    void abandon_lost_places();
    void lose_position();

    // matching.cpp
    void on(const FrameArrived& event);
    void on(const hal::StrobeReport& report);
    void on(const Judged& judged);
    void on(const TriggerRefused& event) { refused(event.part, &Part::frame_due, PartReason::frame_lost); }
    void on(const StrobeRefused& event) { refused(event.part, &Part::light_due, PartReason::strobe_failed); }
    void on(const InspectRefused& event) { refused(event.part, &Part::inspecting, PartReason::inspector_failed); }
    void refused(std::uint32_t number, bool Part::*pending, PartReason reason);
    void note_stray_frame(PartReason stray_frame);
    [[nodiscard]] Part* owner_of(const hal::FrameInfo& frame);
    void judge_when_complete(Part& part);
    void decide(Part& part, PartVerdict verdict, PartReason reason);
    void count_trouble(PartReason reason);

    // rejection.cpp
    void on(const hal::RejectReport& report);
    void on(const RejectRefused& event);
    void settle();
    [[nodiscard]] TimePoint settle(Part& part);
    [[nodiscard]] TimePoint at_ejector(const Part& part) const;
    [[nodiscard]] TimePoint gone_at(const Part& part) const;
    void command_reject(Part& part);
    [[nodiscard]] TimePoint await_report(Part& part);
    void complete(Part& part, RejectState outcome);
    void record(PartResult& result);

    CoreConfig config_;
    State state_ = State::preoperational;
    TimePoint now_{};
    TimePoint next_wake_ = TimePoint::max();
    Actions* actions_ = nullptr;  // during step(), else null
    Answer answer_ = Answer::done;

    std::uint32_t up_ = 0;  // the FaultBits of the devices that work
    bool started_ = false;  // StartDevice was pushed for the devices
    bool ends_ = false;     // end() was called
    bool run_permit_ = false;
    TimePoint permitted_since_;                     // when the run permit was given last
    TimePoint started_at_ = TimePoint::min();       // the last start: a part that came before it is not inspected
    TimePoint looked_after_at_ = TimePoint::min();  // the last reset that ended a line stop
    bool line_stop_ = false;
    LineStop line_stop_why_;
    Duration line_stop_unseen_{};  // until a reset may clear the line stop
    bool draining_ = false;
    bool single_taken_ = false;
    bool plc_lost_ = false;
    std::uint32_t outside_ = 0;  // FaultBits of OutsideFaults
    std::uint32_t trouble_ = 0;  // FaultBits that stay active; devices that are down are not among them
    std::uint32_t faults_latched_ = 0;
    std::uint16_t first_fault_ = 0;
    std::uint32_t failures_in_a_row_ = 0;

    Line line_;
    Conveyor conveyor_;
    std::uint32_t parts_ = 0;
    std::uint32_t accepted_on_line_ = 0;
    TimePoint ejector_rests_at_ = TimePoint::min();  // end of the last pulse commanded
    TimePoint last_arrival_ = TimePoint::min();
    std::optional<std::int64_t> last_arrival_counts_;  // none: the encoder has counted anew since
    TimePoint last_edge_at_ = TimePoint::min();
    std::uint32_t last_edge_ = 0;  // sequence number; 0: none since the part sensor came up
    hal::PartEdge::Kind last_kind_ = hal::PartEdge::Kind::leaves;
    bool leaves_seen_ = false;
    bool covered_ = false;  // the newest part still covers the part sensor
    TimePoint covered_since_;
    std::int64_t covered_since_counts_ = 0;
    bool frames_seen_ = false;
    std::uint32_t last_frame_ = 0;

    Counters counters_;
    std::uint32_t results_ = 0;
    PartResult last_;
    std::uint16_t heartbeat_ = 0;
    TimePoint next_heartbeat_{};
};

}  // namespace hord::firmware
