// The omniscient observer: knows what truly became of every part, and what the station said of it, and compares.
//
// What must never happen (docs: tests/scenario/README.md):
//   - a part leaves the line without having been passed, unless line stop was raised for it;
//   - a part is passed by another part's frame, or a bad one is passed;
//   - a part that was passed is ejected (by a pulse at a belt that stands, after an error, it may be: a good part lost);
//   - a part gets no verdict or two; counters and results disagree; a light is on longer than its limit.
// A fault that no station can see (a valve that acknowledges and does not move) excuses as many parts as it hit, and no more.
#pragma once

#include <array>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <vector>

#include "firmware/core/core.h"
#include "hal_sim/cell/faults.h"
#include "hal_sim/cell/world.h"

namespace hord::firmware {

class Invariants {
  public:
    // `detection_is_perfect`: a passed bad part is the control's fault, not the inspection's.
    Invariants(const sim::FaultPlan& faults, bool detection_is_perfect) : faults_(faults), perfect_(detection_is_perfect) {}

    // From the world.
    void part_arrives(const sim::PartRecord& part);
    void part_is_gone(const sim::PartRecord& part, bool line_may_run);

    // From the station. `judged_by`: the part that was truly in the frame; 0: none.
    void frame_inspected(std::uint32_t station_part, std::uint64_t judged_by);
    void result(const PartResult& result, const Core& core, hal::TimePoint now);
    void line_is_stopped(hal::TimePoint now) { last_stop_ = now; }

    // When the line is empty. `longest_light` was ever on, `limit` allowed.
    void end(const Core& core, hal::Duration longest_light, hal::Duration limit);

    [[nodiscard]] std::uint64_t violations() const { return violations_; }
    [[nodiscard]] std::uint64_t parts_to_violation() const { return newest_at_violation_; }  // that had come by the first one
    [[nodiscard]] const std::vector<std::string>& first_violations() const { return texts_; }
    [[nodiscard]] std::uint64_t results() const { return results_; }
    [[nodiscard]] std::uint64_t passed_bad() const { return passed_bad_; }  // detection's misses, where it is not perfect
    [[nodiscard]] std::uint64_t excused() const { return excused_[0] + excused_[1] + excused_[2]; }
    [[nodiscard]] std::uint64_t of(PartReason reason) const { return reasons_[static_cast<std::size_t>(reason) % reasons_.size()]; }
    [[nodiscard]] std::uint64_t fingerprint() const { return fingerprint_; }  // of every result in order

  private:
    struct Known {
        std::uint64_t number = 0;
        std::int64_t arrived_ns = 0;
        bool stood_still = false;  // the permit was down when it went: ejected by a pulse that was under way
        bool bad = false, gone = false, ejected = false;
        bool has_result = false;
        PartResult result;
    };
    struct Judgement {
        std::uint32_t part = 0;
        std::uint64_t judged_by = 0;
    };
    static constexpr std::size_t kMemory = 1024;  // parts; far more than are ever on the line

    void violation(const std::string& what, std::uint64_t number);
    enum class Excuse : std::uint8_t { unseen, ejected, not_ejected };
    void excuse(Excuse kind, std::initializer_list<sim::Fault> faults, const std::string& what, std::uint64_t number);
    void settle(Known& part);
    [[nodiscard]] Known* arrived_at(std::int64_t ns);

    const sim::FaultPlan& faults_;
    bool perfect_;
    std::array<Known, kMemory> parts_{};
    std::array<Judgement, kMemory> judgements_{};
    std::uint64_t newest_ = 0;
    hal::TimePoint last_stop_ = hal::TimePoint::min();
    std::uint64_t results_ = 0, violations_ = 0, passed_bad_ = 0, newest_at_violation_ = 0, fingerprint_ = 0xCBF29CE484222325U;
    std::array<std::uint64_t, 3> excused_{};  // by Excuse
    std::array<std::uint64_t, 32> reasons_{};
    std::vector<std::string> texts_;
};

}  // namespace hord::firmware
