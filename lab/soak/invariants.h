// The omniscient observer: knows what truly became of every part, and what the station said of it, and compares.
//
// It is told by the world (parts, faults), by the gates (everything that passes between station and devices) and by the
// station (steps, results), and checks at each of them. docs/reliability.md lists the promises; each is one `Promise`
// here. A fault that no station can see excuses the very part that it hit, and no other.
#pragma once

#include <array>
#include <cstdint>
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
    one_verdict,         // each part gets exactly one, results are numbered one by one
    no_bad_part_passes,  // a part leaves only if it was passed; a bad one is passed only by detection's miss
    own_data,            // passed only by its own frame, whole, in its own light, judged good, before the deadline
    own_rejection,       // a part is ejected only by its own command, once; a confirmed rejection has ejected it
    unconfirmed_stops,   // an unconfirmed rejection stops the line
    light_limits,        // lights stay within their limits
    counters_agree,      // the counters are the sums of what was reported
    lawful_states,       // states change as the table says; the run permit only when the line may run
    true_reasons,        // an unfit part's reason names something that really happened
    undisturbed_parts,   // with nothing wrong, good parts pass, bad ones are ejected, and the line runs
    ready_again,         // after the faults the station runs again within its stated time
    bounded,             // queues and memory stay within their bounds
    one_story,           // registers and records tell what the station reported
    commands_once,       // a PLC's command is carried out exactly once
};
inline constexpr std::size_t kPromises = static_cast<std::size_t>(Promise::commands_once) + 1;
std::string_view name_of(Promise promise);  // "one-verdict"

class Invariants {
  public:
    // After the last fault's effect has ended, and after a person's reset, the line runs again within this.
    static constexpr Duration kReadyWithin = milliseconds(5000);

    // The station takes fewer steps than this at one moment.
    static constexpr int kMaxStepsAtOnce = 5000;
    [[nodiscard]] bool time_stands_still() const { return steps_at_once_ > kMaxStepsAtOnce; }

    struct Rules {
        bool perfect_detection = true;  // a passed bad part is the control's fault, not the inspection's
        CoreConfig core;
        std::uint32_t most_on_line = 64;
    };
    // `cell` and `clock` outlive the observer.
    Invariants(const Rules& rules, sim::SimulatedCell& cell, const hal::Clock& clock)
        : rules_(rules), cell_(cell), clock_(clock) {}

    // From the world.
    void part_arrives(const sim::PartRecord& part);
    void part_is_gone(const sim::PartRecord& part);
    void fault(sim::Fault fault, Duration amount);

    // The process: a new core knows nothing of the line; `line_unknown`, and says so.
    void process_starts(const Core& core, const CoreConfig& config);
    void process_ends();

    // From the gates and the inspector. `true_part`: the one that was truly in the frame; 0: none.
    void part_sensor_up(bool up) { part_sensor_up_ = up; }
    void edge_delivered(const hal::PartEdge& edge);
    void lit(const hal::StrobePulse& pulse);
    void strobe_reported(const hal::StrobeReport& report);
    void submitted(std::uint32_t station_part, const hal::FrameInfo& frame, std::uint64_t true_part);
    void judged(const Judged& judged);
    void rejecting(const hal::RejectCommand& command);
    void rejecting_done(bool accepted);

    // From the station.
    void stepped(State before);
    void result(const PartResult& result);

    // From whatever else is held to a promise (registers, records, a PLC's commands).
    void broken(Promise promise, const std::string& what, std::uint64_t part = 0);

    // When the line is empty.
    void end();

    [[nodiscard]] std::uint64_t violations() const { return violations_; }
    [[nodiscard]] std::uint64_t violations_of(Promise promise) const {
        return broken_[static_cast<std::size_t>(promise)];
    }
    [[nodiscard]] const std::vector<std::string>& first_violations() const { return texts_; }
    [[nodiscard]] std::uint64_t parts_to_violation() const {
        return newest_at_violation_;
    }  // that had come by the first one
    [[nodiscard]] std::uint64_t results() const { return results_; }
    [[nodiscard]] std::uint64_t undisturbed() const { return undisturbed_; }  // parts held to the strictest promise
    [[nodiscard]] std::uint64_t passed_bad() const {
        return passed_bad_;
    }                                                                 // detection's misses, where it is not perfect
    [[nodiscard]] std::uint64_t excused() const { return excused_; }  // parts hit by a fault that no station can see
    [[nodiscard]] std::uint64_t of(PartReason reason) const {
        return reasons_[static_cast<std::size_t>(reason) % reasons_.size()];
    }
    [[nodiscard]] std::uint64_t fingerprint() const { return fingerprint_.value(); }  // of every result in order

  private:
    struct Known {
        std::uint64_t number = 0;
        std::int64_t arrived_ns = 0;
        double front_mm = 0;    // belt position at which it came
        double slipped_mm = 0;  // the encoder has lost so much since it came
        bool bad = false;
        bool invisible = false;  // its edge was lost without a trace
        bool delivered = false;  // the station was told of it
        bool commanded = false;  // its rejection was
        bool stuck = false;      // the valve acknowledged and did not move
        bool taken_by_hand = false, ejected = false, gone = false;
        bool process_ended = false;  // while it was on its way
        bool has_result = false;
        PartResult result;
    };
    struct OwnData {  // by station part
        std::uint32_t part = 0;
        bool lit_right = false, submitted = false, frame_right = false, judged_good = false;
        std::uint64_t true_part = 0;
        hal::StrobePulse pulse;
    };
    static constexpr std::size_t kMemory = 512;  // parts; far more than are ever on the line

    [[nodiscard]] Known* arrived_at(std::int64_t ns);
    [[nodiscard]] Known* known_as(std::uint32_t station_part);  // null: a ghost
    [[nodiscard]] OwnData& data_of(std::uint32_t station_part);
    [[nodiscard]] bool belt_stands() const { return cell_.world().stands(); }
    [[nodiscard]] bool by_itself(TimePoint at) const;  // a pulse that the ejector made by itself
    [[nodiscard]] bool any_felt(std::uint64_t faults, TimePoint since) const;
    void forget(const Known& known);
    void check_exit(Known& known);
    void check_ejected(Known& known);
    void check_passed(const PartResult& result, Known* known);
    void check_undisturbed(const PartResult& result, const Known& known);
    void check_reason(const PartResult& result);
    void check_counters();

    Rules rules_;
    sim::SimulatedCell& cell_;
    const hal::Clock& clock_;
    const Core* core_ = nullptr;  // of the process that runs

    std::array<Known, kMemory> parts_{};
    std::array<OwnData, kMemory> data_{};
    std::uint64_t newest_ = 0;
    bool part_sensor_up_ = false;

    std::array<TimePoint, sim::kFaults> felt_until_{};  // by fault: it fired, and its amount is over then; zero: never
    TimePoint faults_until_{};                          // the effects of those that fired last until then
    TimePoint disturbed_until_{};                       // that, and stops and resets
    TimePoint last_close_ = TimePoint::min();           // parts followed each other closely
    TimePoint stepped_at_{};
    int steps_at_once_ = 0;
    TimePoint slipped_at_{}, encoder_silent_until_{};
    double slipped_mm_ = 0;      // by the last slip
    TimePoint stalled_until_{};  // the process does not run
    bool told_not_ready_ = false;
    TimePoint last_line_stop_ = TimePoint::min();
    std::int64_t left_in_outage_at_ = -1;  // a part left while no process could stop the line
    struct Pulse {
        TimePoint from, until;
    };
    std::array<Pulse, 8> own_accord_{};  // pulses that a fault made, newest overwrite oldest
    std::size_t next_own_accord_ = 0;
    hal::RejectCommand rejecting_;
    TimePoint light_until_ = TimePoint::min();
    bool ever_lit_ = false;

    Counters counted_;  // when they were checked last
    std::uint32_t counted_results_ = 0;
    Counters told_;  // summed from the results of this process
    std::uint32_t told_inspected_ = 0, results_in_process_ = 0;
    std::uint64_t results_ = 0, violations_ = 0, passed_bad_ = 0, excused_ = 0, undisturbed_ = 0,
                  newest_at_violation_ = 0;
    common::Fnv1a64 fingerprint_;
    std::array<std::uint64_t, 32> reasons_{};
    std::array<std::uint64_t, kPromises> broken_{};
    std::vector<std::string> texts_;
};

}  // namespace hord::lab
