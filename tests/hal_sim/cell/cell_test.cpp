#include "hal_sim/cell/cell.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "lab/virtual_time/virtual_time.h"
#include "tests/hal_sim/cell/tiny_station.h"

namespace hord::sim {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::Each;
using testing::ElementsAre;
using testing::HasSubstr;

class Cell : public testing::Test {
  protected:
    Cell() {
        options_.schedule.parts = 40;
        options_.schedule.kinds = {{"good", false, 3}, {"bubble", true, 1}};
    }
    // The whole schedule, from the first part to the last.
    TinyStation& run() {
        auto made = SimulatedCell::make(loop_, frames_, options_);
        EXPECT_TRUE(made) << made.error().message();
        cell_ = std::move(*made);
        history_.clear();
        cell_->watch({.part_gone = [this](const PartRecord& part) { history_.push_back(part); }});
        station_.emplace(*cell_, options_);
        cell_->start();
        EXPECT_TRUE(loop_.run_until([&] { return cell_->finished(); }, loop_.now() + 1h));
        loop_.run_for(1s);
        return *station_;
    }
    void add(InjectedFault fault, std::uint64_t at, hal::Duration amount = {}) {
        options_.faults.push_back({.fault = fault, .probability = 1, .first = at, .last = at, .amount = amount});
    }
    std::vector<std::uint64_t> numbers_seen() {
        std::vector<std::uint64_t> out;
        for (const auto& frame : station_->frames) out.push_back(frame.token ? frame.token->part : 0);
        return out;
    }

    lab::VirtualTime loop_;
    TokenFrames frames_{{27, 18, 8}};
    CellOptions options_;
    std::unique_ptr<SimulatedCell> cell_;
    std::vector<PartRecord> history_;  // of the last run, in the order in which parts left
    std::optional<TinyStation> station_;
};

TEST_F(Cell, without_faults_every_frame_shows_its_own_part_and_just_the_bad_ones_are_ejected) {
    options_.conveyor.jitter = 0.01;
    options_.schedule.pitch_jitter = 0.1;
    const auto& station = run();
    ASSERT_EQ(station.frames.size(), 40U);
    for (std::size_t k = 0; k < 40; ++k) {
        ASSERT_TRUE(station.frames[k].token);
        EXPECT_EQ(station.frames[k].token->part, k + 1);
        EXPECT_EQ(cell_->sensor().true_part_of(station.frames[k].info.sequence), k + 1);
    }
    ASSERT_EQ(history_.size(), 40U);
    std::size_t bad = 0;
    for (const PartRecord& part : history_) {
        EXPECT_EQ(part.fate, part.bad ? PartRecord::Fate::ejected : PartRecord::Fate::left) << part.number;
        EXPECT_EQ(part.exposures, 1U);
        bad += part.bad ? 1 : 0;
    }
    EXPECT_GT(bad, 3U);
    EXPECT_LT(bad, 20U);
    EXPECT_EQ(cell_->world().totals().ejected_bad, bad);
    EXPECT_EQ(cell_->world().totals().left_good, 40 - bad);
    EXPECT_EQ(cell_->world().totals().empty_pulses, 0U);
    EXPECT_THAT(station.rejects,
                Each(testing::Field(&hal::RejectReport::outcome, hal::RejectReport::Outcome::confirmed)));
}

TEST_F(Cell, is_over_once_the_last_part_is_past_the_exit_also_if_that_part_was_ejected) {
    options_.schedule.parts = 2;
    options_.schedule.kinds = {{"bubble", true, 1}};
    int gone = 0, over = 0;
    auto made = SimulatedCell::make(loop_, frames_, options_);
    ASSERT_TRUE(made) << made.error().message();
    cell_ = std::move(*made);
    cell_->watch({.part_gone = [&](const PartRecord& part) { gone += part.fate == PartRecord::Fate::ejected ? 1 : 0; },
                  .over =
                      [&] {
                          ++over;
                          EXPECT_TRUE(cell_->finished());
                          EXPECT_EQ(gone, 2);
                      }});
    station_.emplace(*cell_, options_);
    cell_->start();
    loop_.run_for(1h);
    EXPECT_EQ(over, 1);
}

TEST_F(Cell, without_its_run_permit_the_belt_stands_from_the_start) {
    options_.schedule.parts = 1;
    auto made = SimulatedCell::make(loop_, frames_, options_);
    ASSERT_TRUE(made) << made.error().message();
    cell_ = std::move(*made);
    hal::TimePoint came{};
    cell_->watch({.part_edge = [&](const PartRecord&, bool arrives, hal::TimePoint at) {
        if (arrives) came = at;
    }});
    cell_->world().halt();
    cell_->start();
    loop_.run_for(1h);
    EXPECT_EQ(came, hal::TimePoint{});
    EXPECT_TRUE(cell_->world().stands());
    const hal::TimePoint permitted = loop_.now();
    cell_->world().resume();
    loop_.run_for(1h);
    EXPECT_EQ(came, permitted + options_.travel(options_.schedule.first_mm));
}

TEST_F(Cell, without_feed_no_part_comes_and_afterwards_they_come_as_far_apart_as_before) {
    options_.schedule.parts = 3;
    std::vector<double> fronts_mm;
    int ends = 0, gone = 0;
    auto made = SimulatedCell::make(loop_, frames_, options_);
    ASSERT_TRUE(made) << made.error().message();
    cell_ = std::move(*made);
    cell_->watch({.part_edge =
                      [&](const PartRecord& part, bool arrives, hal::TimePoint) {
                          if (arrives) fronts_mm.push_back(part.front_mm);
                          ends += arrives ? 0 : 1;
                          if (part.number == 1 && !arrives) cell_->world().feed(false);
                      },
                  .part_gone = [&](const PartRecord&) { ++gone; }});
    station_.emplace(*cell_, options_);
    cell_->start();
    loop_.run_for(1h);
    ASSERT_EQ(fronts_mm.size(), 1U);
    EXPECT_EQ(ends, 1) << "a part that has not come uncovered the sensor";
    EXPECT_EQ(gone, 1) << "a part that has not come left the line";
    cell_->world().feed(true);
    cell_->world().feed(true);
    loop_.run_for(1h);
    ASSERT_EQ(fronts_mm.size(), 3U);
    EXPECT_TRUE(cell_->finished());
    EXPECT_GT(fronts_mm[1] - fronts_mm[0], options_.schedule.pitch_mm * 1000);
    EXPECT_NEAR(fronts_mm[2] - fronts_mm[1], options_.schedule.pitch_mm, 1e-6);
}

// The process was suspended while the part came; it stops the feed before it handles any other event.
TEST_F(Cell, a_part_that_was_due_when_the_feed_stopped_comes_when_it_goes_on) {
    options_.schedule.parts = 3;
    std::vector<hal::TimePoint> came;
    auto made = SimulatedCell::make(loop_, frames_, options_);
    ASSERT_TRUE(made) << made.error().message();
    cell_ = std::move(*made);
    cell_->watch({.part_edge = [&](const PartRecord& part, bool arrives, hal::TimePoint at) {
        if (arrives) came.push_back(at);
        if (part.number != 1 || arrives) return;
        loop_.stall(5s);
        cell_->world().feed(false);
    }});
    station_.emplace(*cell_, options_);
    cell_->start();
    loop_.run_for(1h);
    ASSERT_EQ(came.size(), 1U);
    const hal::TimePoint again = loop_.now();
    cell_->world().feed(true);
    loop_.run_for(1h);
    ASSERT_EQ(came.size(), 3U);
    EXPECT_GE(came[1], again);
    EXPECT_EQ(came[2] - came[1], 100ms);
}

// The process was suspended while the part came. Then the belt and the feed stop, as after a line stop.
TEST_F(Cell, a_part_that_was_due_when_belt_and_feed_stopped_comes_after_the_belt_runs_again) {
    options_.schedule.parts = 2;
    std::vector<hal::TimePoint> came;
    auto made = SimulatedCell::make(loop_, frames_, options_);
    ASSERT_TRUE(made) << made.error().message();
    cell_ = std::move(*made);
    cell_->watch({.part_edge = [&](const PartRecord& part, bool arrives, hal::TimePoint at) {
        if (arrives) came.push_back(at);
        if (part.number != 1 || arrives) return;
        loop_.stall(5s);
        cell_->world().halt();
        cell_->world().feed(false);
    }});
    station_.emplace(*cell_, options_);
    cell_->start();
    loop_.run_for(3min);
    ASSERT_EQ(came.size(), 1U);
    const hal::TimePoint again = loop_.now();
    cell_->world().resume();
    cell_->world().feed(true);
    loop_.run_for(1s);
    ASSERT_EQ(came.size(), 2U);
    EXPECT_GT(came[1], again);
    EXPECT_LT(came[1], again + 1ms);
}

TEST_F(Cell, edges_have_the_true_time_and_the_records_name_it) {
    const auto& station = run();
    ASSERT_EQ(station.edges.size(), 80U);
    EXPECT_EQ(station.edges[0].at, lab::VirtualTime::kStart + 100ms);  // 50 mm at 500 mm/s
    EXPECT_EQ(station.edges[1].at - station.edges[0].at, 40ms);        // 20 mm of part
    EXPECT_EQ(station.edges[2].at - station.edges[0].at, 100ms);       // 50 mm of pitch
    for (const PartRecord& part : history_) EXPECT_EQ(station.edges[2 * (part.number - 1)].at, part.arrived);
}

TEST_F(Cell, the_same_seed_gives_the_same_story_and_another_seed_another) {
    options_.conveyor.jitter = 0.02;
    options_.schedule.pitch_jitter = 0.2;
    const auto story = [&](std::uint64_t seed) {
        options_.seed = seed;
        const hal::TimePoint start = loop_.now();
        run();
        std::string text;
        for (const PartRecord& p : history_) {
            text += std::to_string(p.kind) + "@" + std::to_string((p.arrived - start).count()) + "," +
                std::to_string((p.gone - start).count()) + " ";
        }
        station_.reset();
        cell_.reset();
        return text;
    };
    const std::string first = story(7);
    EXPECT_EQ(story(7), first);
    EXPECT_NE(story(8), first);
}

TEST_F(Cell, the_belt_stands_still_during_a_stop_and_the_encoder_with_it) {
    options_.conveyor.stops = {{.after = 550ms, .length = 2s}};
    options_.part_sensor.encoder_counts_per_mm = 10;
    const auto& station = run();
    EXPECT_EQ(station.edges[8].at - station.edges[6].at, 100ms);
    EXPECT_EQ(station.edges[10].at - station.edges[8].at, 2100ms);
    EXPECT_EQ(station.edges[0].counts, 500);
    for (const auto& reading : station.readings) {
        const auto since = reading.at - lab::VirtualTime::kStart;
        if (since >= 550ms && since <= 2550ms) {
            EXPECT_NEAR(static_cast<double>(reading.counts), 2750, 1);
        }
    }
}

TEST_F(Cell, halting_the_belt_moves_everything_that_is_to_come) {
    options_.schedule.parts = 3;
    auto cell = std::move(*SimulatedCell::make(loop_, frames_, options_));
    std::vector<hal::TimePoint> arrived;
    cell->watch({.part_edge =
                     [&](const PartRecord&, bool arrives, hal::TimePoint at) {
                         if (arrives) arrived.push_back(at);
                     },
                 .part_gone = {},
                 .ejector = {}});
    cell->start();
    loop_.run_for(150ms);
    cell->world().halt();
    loop_.run_for(10s);
    EXPECT_EQ(arrived.size(), 1U);
    cell->world().resume();
    loop_.run_for(1s);
    EXPECT_THAT(arrived,
                ElementsAre(lab::VirtualTime::kStart + 100ms, lab::VirtualTime::kStart + 10200ms,
                            lab::VirtualTime::kStart + 10300ms));
}

TEST_F(Cell, frame_faults_do_what_they_say_and_are_counted) {
    options_.schedule.kinds = {{"good", false, 1}};
    options_.schedule.parts = 10;
    add(InjectedFault::frame_drop, 1);
    add(InjectedFault::frame_duplicate, 2);
    add(InjectedFault::frame_stale, 4);
    add(InjectedFault::frame_short, 5);
    add(InjectedFault::frame_corrupt, 6);
    add(InjectedFault::frame_dark, 7);
    add(InjectedFault::frame_saturated, 8);
    add(InjectedFault::frame_late, 9, 1s);
    const auto& s = run();
    EXPECT_THAT(numbers_seen(), ElementsAre(1, 3, 3, 4, 4, 6, 7, 0, 0, 10));
    std::vector<std::uint32_t> sequences;
    for (const auto& frame : s.frames) sequences.push_back(frame.info.sequence);
    EXPECT_THAT(sequences, ElementsAre(1, 3, 3, 4, 5, 6, 7, 8, 9, 10));
    EXPECT_EQ(s.frames[4].info.exposure_start, s.frames[3].info.exposure_start);  // stale: the old time
    EXPECT_EQ(cell_->sensor().true_part_of(5), 4U);
    EXPECT_EQ(s.frames[5].info.bytes_used, 27U * 18U / 2U);
    EXPECT_TRUE(s.frames[6].info.corrupt);
    EXPECT_THAT(cell_->faults().never_fired(), testing::IsEmpty());
}

TEST_F(Cell, strobe_faults_change_the_light_and_only_honest_ones_are_reported) {
    options_.schedule.parts = 7;
    add(InjectedFault::strobe_dead, 1);
    add(InjectedFault::strobe_refused, 2);
    add(InjectedFault::strobe_weak, 3);
    add(InjectedFault::strobe_late, 4);
    add(InjectedFault::strobe_short, 6);
    const auto& s = run();
    EXPECT_THAT(numbers_seen(), ElementsAre(1, 0, 0, 0, 0, 6, 7));
    ASSERT_EQ(s.strobes.size(), 7U);
    std::vector<bool> lit;
    for (const auto& report : s.strobes) lit.push_back(report.lit);
    EXPECT_THAT(lit, ElementsAre(true, true, false, true, true, true, true));
    EXPECT_EQ(s.strobes[5].width - s.strobes[6].width, 22us);
    EXPECT_EQ(s.strobes[4].start - s.strobes[3].start, 102ms);
    EXPECT_LE(cell_->strobe().longest_on(), options_.strobe.limits.max_on);
}

TEST_F(Cell, edge_faults_show_in_the_sequence_or_not_at_all) {
    options_.schedule.parts = 6;
    add(InjectedFault::edge_lost, 1);
    add(InjectedFault::edge_missed, 2);
    add(InjectedFault::edge_bounce, 3);
    add(InjectedFault::edge_ghost, 4);
    const auto& s = run();
    std::string kinds;
    std::vector<std::uint32_t> gaps;
    for (std::size_t k = 0; k < s.edges.size(); ++k) {
        kinds += s.edges[k].kind == hal::PartEdge::Kind::arrives ? 'a' : 'l';
        if (k > 0 && s.edges[k].sequence != s.edges[k - 1].sequence + 1) gaps.push_back(s.edges[k].sequence);
    }
    //           1    2   4 and its bounce  5 and a ghost  6
    EXPECT_EQ(kinds,
              "al"
              "l"
              "alalal"
              "aal"
              "al");
    EXPECT_THAT(gaps, ElementsAre(4U));
}

TEST_F(Cell, reject_faults_decide_what_truly_happens_to_the_part) {
    options_.schedule.kinds = {{"bubble", true, 1}};
    options_.schedule.parts = 7;
    add(InjectedFault::reject_lost, 1);
    add(InjectedFault::reject_late, 2);  // 100 ms late: it hits part 4
    add(InjectedFault::ejector_stuck, 5);
    add(InjectedFault::reject_unacknowledged, 6);
    const auto& s = run();
    std::vector<PartRecord::Fate> fates(7);
    for (const PartRecord& part : history_) fates[part.number - 1] = part.fate;
    using enum PartRecord::Fate;
    EXPECT_THAT(fates, ElementsAre(ejected, left, left, ejected, ejected, left, ejected));
    using Outcome = hal::RejectReport::Outcome;
    std::vector<Outcome> outcomes(7);
    for (const auto& report : s.rejects) outcomes[report.part - 1] = report.outcome;
    EXPECT_THAT(outcomes,
                ElementsAre(Outcome::confirmed, Outcome::failed, Outcome::late, Outcome::confirmed, Outcome::confirmed,
                            Outcome::confirmed, Outcome::failed));
    EXPECT_EQ(cell_->world().totals().left_bad, 3U);
}

TEST_F(Cell, taking_a_rule_away_leaves_the_others_where_they_were) {
    const auto fired = [](std::vector<InjectionRule> rules) {
        InjectionPlan plan(42, std::move(rules));
        std::vector<int> at;
        for (int k = 0; k < 1000; ++k) {
            if (plan.fires(InjectedFault::frame_drop)) at.push_back(k);
            (void)plan.fires(InjectedFault::frame_late);
        }
        return at;
    };
    const InjectionRule drop{.fault = InjectedFault::frame_drop, .probability = 0.01},
        late{.fault = InjectedFault::frame_late, .probability = 0.5};
    EXPECT_EQ(fired({drop, late}), fired({drop}));
    EXPECT_THAT(fired({drop}).size(), AllOf(testing::Ge(3U), testing::Le(25U)));
}

TEST_F(Cell, every_fault_has_a_name_that_finds_it_again) {
    for (std::size_t k = 0; k < kInjectedFaults; ++k) {
        const auto fault = static_cast<InjectedFault>(k);
        EXPECT_EQ(injected_fault_named(name_of(fault)), fault) << k;
    }
    EXPECT_EQ(injected_fault_named("frame-eaten"), std::nullopt);
}

TEST_F(Cell, impossible_options_are_all_named_at_once) {
    options_.conveyor.speed_mm_s = 0;
    options_.schedule.kinds.clear();
    options_.geometry.exit_mm = 10;
    options_.sensor.buffers = 0;
    const auto made = SimulatedCell::make(loop_, frames_, options_);
    ASSERT_FALSE(made);
    EXPECT_EQ(made.error().code, ErrorCode::invalid_argument);
    EXPECT_THAT(made.error().what,
                AllOf(HasSubstr("speed_mm_s"), HasSubstr("kinds"), HasSubstr("exit"), HasSubstr("buffers")));
}

}  // namespace
}  // namespace hord::sim
