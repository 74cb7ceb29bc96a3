// The omniscient observer: compares the true history of each part with the station's reports.
//
// The world reports parts and faults, the device proxies each call between station and devices, the station its steps
// and results; each report is checked at once. Each promise of docs/reliability.md is one `Promise` here. A fault that
// no station can detect excuses exactly the part that it hit.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/hash.h"
#include "drivers/hal/event_loop.h"
#include "firmware/core/core.h"
#include "hal_sim/cell/cell.h"

namespace hord::lab {

using namespace firmware;

enum class Promise : std::uint8_t {
    one_verdict,         // each part gets exactly one verdict, and results are numbered without gaps
    no_bad_part_passes,  // a part leaves only if it was passed; a bad one is passed only where detection missed it
    own_data,            // passed only if its own complete frame, lit by its own pulse, was judged good in time
    own_rejection,       // ejected only by its own command, once; after a confirmed rejection it is ejected
    unconfirmed_stops,   // an unconfirmed rejection stops the line
    light_limits,        // lights stay within their limits
    counters_agree,      // the counters are the sums of what was reported
    lawful_states,       // states change as in the transition table; run permit only in states that allow it
    true_reasons,        // an unfit part's reason has a real cause
    undisturbed_parts,   // without faults, good parts pass, bad ones are ejected, and the line runs
    ready_again,         // after a fault the station runs again within kReadyWithin
    bounded,             // queues and memory stay within their bounds
    one_story,           // registers and records agree with what the station reported
    commands_once,       // a PLC's command is carried out exactly once
};
inline constexpr std::size_t kPromises = static_cast<std::size_t>(Promise::commands_once) + 1;
std::string_view name_of(Promise promise);  // "one-verdict"

class Invariants {
  public:
    // The line runs again within this time after the last fault's effect has ended and a person has reset.
    static constexpr Duration kReadyWithin = milliseconds(5000);

    // The station takes fewer steps than this at one instant; otherwise virtual time would not advance.
    static constexpr int kMaxStepsAtOnce = 5000;
    [[nodiscard]] bool time_stands_still() const { return steps_at_once_ > kMaxStepsAtOnce; }

    struct Rules {
        bool perfect_detection = true;  // a bad part that passes is the controller's error, not the inspection's
        CoreConfig core;
        std::uint32_t most_on_line = 64;
    };
    // `cell` and `clock` outlive the observer.
    Invariants(const Rules& rules, sim::SimulatedCell& cell, const hal::Clock& clock)
        : rules_(rules), cell_(cell), clock_(clock) {}

    // Called by the world.
    void part_arrives(const sim::PartRecord& part);
    void part_is_gone(const sim::PartRecord& part);
    void fault(sim::InjectedFault fault, Duration amount);

    // A new process has a new core, which does not know what is on the line.
    void process_starts(const Core& core, const CoreConfig& config);
    void process_ends();

    // Called by the device proxies and the inspector. `true_part`: the part that was really in the frame; 0: none.
    void part_sensor_up(bool up) { part_sensor_up_ = up; }
    void edge_delivered(const hal::PartEdge& edge);
    void lit(const hal::StrobePulse& pulse);
    void strobe_reported(const hal::StrobeReport& report);
    struct FrameTruth {
        std::uint64_t part = 0;     // that it shows
        std::uint32_t trigger = 0;  // the station part whose exposure request made it
    };
    void submitted(std::uint32_t station_part, const hal::FrameInfo& frame, const FrameTruth& truth);
    void judged(const Judged& judged);
    void rejecting(const hal::RejectCommand& command);
    void rejecting_done(bool accepted);
    void reject_reported(const hal::RejectReport& report);

    // Called by the station.
    void stepped(State before, const Event& event);
    void result(const PartResult& result);

    // What the registers show of the faults: the first one stays until a reset.
    void faults_shown(std::uint16_t first_fault, std::uint32_t latched);

    // Called by other checks (registers, records, a PLC's commands): counts a violation.
    void broken(Promise promise, const std::string& what, std::uint64_t part = 0);

    // When the line is empty.
    void end();

    [[nodiscard]] std::uint64_t violations() const { return violations_; }
    [[nodiscard]] std::uint64_t violations_of(Promise promise) const {
        return broken_[static_cast<std::size_t>(promise)];
    }
    [[nodiscard]] const std::vector<std::string>& first_violations() const { return texts_; }
    // Parts that had arrived by the first violation.
    [[nodiscard]] std::uint64_t parts_to_violation() const { return newest_at_violation_; }
    [[nodiscard]] std::uint64_t results() const { return results_; }
    [[nodiscard]] std::uint64_t undisturbed() const { return undisturbed_; }  // parts checked for undisturbed_parts
    [[nodiscard]] std::uint64_t passed_bad() const { return passed_bad_; }    // bad parts that the inspection missed
    [[nodiscard]] std::uint64_t excused() const { return excused_; }          // hit by a fault no station can detect
    [[nodiscard]] std::uint64_t of(PartReason reason) const {
        return reasons_[static_cast<std::size_t>(reason) % reasons_.size()];
    }
    [[nodiscard]] std::uint64_t fingerprint() const { return fingerprint_.value(); }  // of every result in order

  private:
    struct PartHistory {
        std::uint64_t number = 0;
        std::int64_t arrived_ns = 0;
        double front_mm = 0;    // belt position at its arrival
        double slipped_mm = 0;  // lost by the encoder since its arrival
        bool bad = false;
        bool invisible = false;    // the sensor gave no edge for it
        bool touches = false;      // the part ahead: no edge between the two
        bool touched = false;      // by the part behind, unless that is taken away first
        bool station_ran = false;  // the station executed when the part came
        bool permitted = false;    // the line had its run permit when the part came
        bool delivered = false;    // the station received its edge
        bool commanded = false;    // the station commanded its rejection
        bool stuck = false;        // the valve acknowledged and did not move
        bool taken_by_hand = false, ejected = false, gone = false;
        bool process_ended = false;  // while it was on the line
        bool has_result = false;
        PartResult result;
    };
    struct Evidence {  // what the station may base a pass on, by station part
        std::uint32_t part = 0;
        bool light_correct = false, submitted = false, frame_correct = false, judged_good = false;
        std::uint64_t true_part = 0;
        hal::StrobePulse pulse;
        bool reject_told = false;
        hal::RejectReport report;  // the first one
    };
    static constexpr std::size_t kMemory = 512;  // parts; far more than fit on the line

    [[nodiscard]] PartHistory* arrived_at(std::int64_t ns);
    [[nodiscard]] PartHistory* history_of(std::uint32_t station_part);  // null: there is no such part
    [[nodiscard]] Evidence& evidence_of(std::uint32_t station_part);
    [[nodiscard]] bool belt_stands() const { return cell_.world().stands(); }
    [[nodiscard]] bool pulsed_by_fault(TimePoint at) const;  // a fault made the ejector pulse
    [[nodiscard]] bool any_in_effect(std::uint64_t faults, TimePoint since) const;
    void watch_belt();
    [[nodiscard]] Duration belt_stood(TimePoint from, TimePoint until) const;
    [[nodiscard]] bool stood_before_camera(const PartHistory& history) const;
    [[nodiscard]] TimePoint edge_ahead(TimePoint arrived) const;
    void watch_line_stop();
    void check_finished(const PartHistory& history);
    void check_exit(PartHistory& history, TimePoint left);
    void check_ejected(PartHistory& history);
    void check_passed(const PartResult& result, PartHistory* history);
    void check_event(State before, const Event& event);
    void check_failures_in_a_row();
    void check_rejection(const PartResult& result);
    void check_undisturbed(const PartResult& result, const PartHistory& history);
    void check_reason(const PartResult& result);
    void check_counters();
    void check_missed(State before, const Event& event);
    [[nodiscard]] bool hides_a_part(const hal::PartEdge& leaves);

    Rules rules_;
    sim::SimulatedCell& cell_;
    const hal::Clock& clock_;
    const Core* core_ = nullptr;  // of the process that runs

    std::array<PartHistory, kMemory> parts_{};
    std::array<Evidence, kMemory> evidence_{};
    std::uint64_t newest_ = 0;
    bool part_sensor_up_ = false;

    std::array<TimePoint, sim::kInjectedFaults> effect_until_{};  // by fault: end of its effect; zero: it never fired
    TimePoint faults_until_{};                                    // end of the effects of all faults that fired
    TimePoint disturbed_until_{};                                 // the same, including stops and resets
    TimePoint last_close_ = TimePoint::min();                     // a part followed the one ahead too closely
    TimePoint stepped_at_{};
    int steps_at_once_ = 0;
    TimePoint slipped_at_{}, encoder_silent_until_{};
    double slipped_mm_ = 0;      // in the last slip
    TimePoint stalled_until_{};  // the process is not scheduled until then
    bool not_ready_reported_ = false;
    TimePoint last_line_stop_ = TimePoint::min();
    struct Interval {
        TimePoint from, until;
    };
    Interval line_stop_{TimePoint::min(), TimePoint::min()};  // the newest one; `until`: a reset cleared it, or now
    bool had_line_stop_ = false;
    // The newest part that left while no process could stop the line. `until`: the observer was told.
    std::optional<Interval> left_in_outage_;
    struct Stand {
        TimePoint from, until;
        double belt_mm = 0;
    };
    std::array<Stand, 16> stands_{};  // of the belt; the newest overwrites the oldest
    std::size_t next_stand_ = 0;
    std::array<TimePoint, 64> edges_{};  // arrivals that were told, also those without a part
    std::size_t next_edge_ = 0;
    bool stood_ = false;
    std::array<Interval, 8> fault_pulses_{};  // made by faults; the newest overwrites the oldest
    std::size_t next_fault_pulse_ = 0;
    hal::RejectCommand last_reject_;
    // Of this process.
    TimePoint pulse_until_{};         // end of the last pulse commanded
    TimePoint pulse_until_before_{};  // the same before this step: the step of an arm may command a pulse
    TimePoint permit_lost_at_{};      // the run permit was withdrawn
    bool had_permit_ = false;
    std::uint16_t first_fault_ = 0;  // shown since the last reset
    TimePoint light_until_ = TimePoint::min();
    bool ever_lit_ = false;

    std::uint32_t missed_ = 0;               // the station's count after its last step
    std::uint32_t missed_at_front_ = 0;      // after the newest edge `arrives`
    std::uint32_t last_edge_ = 0;            // number of the newest edge since the part sensor came up
    TimePoint front_at_ = TimePoint::min();  // of the newest edge `arrives`
    Counters checked_counters_;              // at the last check
    std::uint32_t checked_results_ = 0;
    Counters reported_;  // sums over the results of this process
    std::uint32_t reported_inspected_ = 0, results_in_process_ = 0;
    std::uint64_t results_ = 0, violations_ = 0, passed_bad_ = 0, excused_ = 0, undisturbed_ = 0,
                  newest_at_violation_ = 0;
    common::Fnv1a64 fingerprint_;
    std::array<std::uint64_t, 32> reasons_{};
    std::array<std::uint64_t, kPromises> broken_{};
    std::vector<std::string> texts_;
};

}  // namespace hord::lab
