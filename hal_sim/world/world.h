// The ground truth of the cell: belt, parts, light, ejector.
//
// Positions are belt travel since the part's front edge crossed the part sensor, in mm. The world acts on timers of its
// event loop and computes with the times at which events are due, not with those of the callbacks: on a real-time loop
// an edge has its exact time even when its callback is late.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "drivers/hal/event_loop.h"
#include "hal_sim/world/conveyor.h"
#include "hal_sim/world/fault_injection.h"

namespace hord::sim {

struct PartKind {
    std::string name;
    bool bad = false;
    double share = 1;  // of all parts, relative to the other kinds' shares
};

struct ScheduleOptions {
    std::uint64_t parts = 0;  // how many come; 0: no end
    double first_mm = 50;     // belt travel before the first
    double pitch_mm = 50;     // from front edge to front edge
    double pitch_jitter = 0;  // share of the pitch, uniform
    double part_length_mm = 20;
    std::vector<PartKind> kinds = {{"good", false, 1}};
};

struct GeometryOptions {
    double camera_mm = 100;       // the part is centred before the camera
    double camera_reach_mm = 12;  // it is at least partly in view within this of the centre
    double ejector_mm = 400;      // centred before the ejector
    double ejector_reach_mm = 6;  // the ejector hits it within this of the centre
    double exit_mm = 500;         // it has left the line
};

// What really happened to a part.
struct PartRecord {
    enum class Fate : std::uint8_t { on_line, ejected, left, removed };  // removed: taken off by hand
    std::uint64_t number = 0;                                            // from 1, in the order of arrival
    std::size_t kind = 0;                                                // index into ScheduleOptions::kinds
    bool bad = false;
    bool touches_ahead = false, touched_behind = false;  // no edge between the two
    double front_mm = 0;                                 // belt position at which its front crosses the sensor
    hal::TimePoint arrived;       // time of that crossing: equals PartEdge::at, except under a fault
    std::uint32_t exposures = 0;  // frames taken of it
    Fate fate = Fate::on_line;
    hal::TimePoint gone;  // ejected, left or removed
};

struct WorldTotals {
    std::uint64_t arrived = 0, ejected_good = 0, ejected_bad = 0, left_good = 0, left_bad = 0, removed = 0;
    std::uint64_t ejector_pulses = 0, empty_pulses = 0;  // empty: no part was there
};

class World {
  public:
    // Observers, called on the loop's thread; any may be empty.
    struct Watchers {
        std::function<void(const PartRecord&, bool arrives, hal::TimePoint at)> part_edge{};  // front, then back edge
        std::function<void(const PartRecord&)> part_gone{};           // called when its fate is decided
        std::function<void(bool open, hal::TimePoint at)> ejector{};  // the valve moved
        std::function<void()> over{};                                 // finished(): nothing more will come
    };

    World(hal::EventLoop& loop, InjectionPlan& faults, const ConveyorOptions& conveyor, const ScheduleOptions& schedule,
          const GeometryOptions& geometry, std::uint64_t seed);
    ~World();
    World(const World&) = delete;
    World& operator=(const World&) = delete;

    void watch(Watchers watchers) { watchers_ = std::move(watchers); }

    // Starts the belt at the loop's now(), or at resume() after a halt(). Call once.
    void start();

    // Stops and starts the belt: the run permit. Without a call it has its permit. run_out() stops it as the withdrawn
    // permit does: it may coast (fault belt_coasts). Then the feeder lets go of the part that it holds before an empty
    // line.
    void halt();
    void run_out();
    void resume();

    // Whether parts are put on the belt. When it ends, parts that have not reached the part sensor wait, and come with
    // the same spacing once it begins again.
    void feed(bool on);

    [[nodiscard]] bool stands() const { return !conveyor_ || conveyor_->halted(); }

    // A person takes parts off the belt: those between part sensor and exit for which `takes` returns true.
    void take_off(const std::function<bool(const PartRecord&)>& takes);

    // The ejector's valve opens or closes. Parts in front of it while it is open are ejected. `at` may lie a little in
    // the past.
    void set_ejector(bool open, hal::TimePoint at);

    // The part in view whose centre is nearest to the camera's, if any, and its distance past the centre, mm.
    struct InView {
        PartRecord* part = nullptr;
        double offset_mm = 0;
    };
    [[nodiscard]] InView in_view(hal::TimePoint at);

    [[nodiscard]] double belt_mm(hal::TimePoint at) { return conveyor_ ? conveyor_->position_mm(at) : 0; }
    [[nodiscard]] hal::Duration coast() const { return coast_; }  // of run_out()
    [[nodiscard]] double nominal_speed_mm_s() const { return conveyor_options_.speed_mm_s; }
    [[nodiscard]] const WorldTotals& totals() const { return totals_; }
    [[nodiscard]] bool finished() const;  // every scheduled part is gone
    [[nodiscard]] const ScheduleOptions& schedule() const { return schedule_; }
    [[nodiscard]] const GeometryOptions& geometry() const { return geometry_; }

  private:
    void draw_part();
    void plan();  // one timer, for the next event
    void act();
    void eject_between(hal::TimePoint from, hal::TimePoint until);
    void settle(PartRecord& part, PartRecord::Fate fate, hal::TimePoint at);
    void apply_arrival_faults(const PartRecord& arrived);
    void move();  // starts or stops the belt, by permit and belt_stop
    PartRecord* with_index(std::uint64_t index) {
        return index < first_index_ || index >= first_index_ + line_.size() ? nullptr : &line_[index - first_index_];
    }

    hal::EventLoop& loop_;
    InjectionPlan& faults_;
    ConveyorOptions conveyor_options_;
    ScheduleOptions schedule_;
    GeometryOptions geometry_;
    std::uint64_t seed_;
    Watchers watchers_;
    std::optional<Conveyor> conveyor_;
    bool may_move_ = true;  // the run permit
    std::optional<double> unfed_since_mm_;
    std::uint32_t stopped_ = 0;  // active belt_stop faults
    hal::Duration coast_{};      // of the last belt_coasts fault

    // Parts in order; line_[0] has index first_index_. All three cursors are indices.
    std::deque<PartRecord> line_;
    std::uint64_t first_index_ = 0;
    std::uint64_t next_arrival_ = 0, next_departure_ = 0, next_exit_ = 0;
    std::uint64_t drawn_ = 0;
    double last_front_mm_ = 0;
    double share_sum_ = 0;

    std::vector<hal::EventLoop::TimerId> meddling_;
    hal::EventLoop::TimerId timer_{}, coasting_{};
    enum class Next : std::uint8_t { nothing, arrival, departure, exit };
    Next next_ = Next::nothing;
    hal::TimePoint next_at_;

    std::optional<hal::TimePoint> ejector_open_since_;
    std::uint64_t hit_by_pulse_ = 0;
    WorldTotals totals_;
};

}  // namespace hord::sim
