#include "tests/system/scenario/scenario.h"

namespace hord::lab {
namespace {

TEST(PartsTooClose, a_bouncing_edge_rejects_the_part) {
    LineOptions options = timed_line(6, 100);
    options.cell.faults = {always(sim::InjectedFault::edge_bounce, 20, 21)};
    const auto line = run_scenario(options);
    ASSERT_NE(line, nullptr);
    EXPECT_GE(line->invariants().of(PartReason::parts_too_close), 2U);
}

TEST(PartsTooClose, a_ghost_behind_a_part_rejects_both) {
    LineOptions options = timed_line(7, 100);
    options.cell.faults = {always(sim::InjectedFault::edge_ghost, 20, 20)};
    const auto line = run_scenario(options);
    ASSERT_NE(line, nullptr);
    EXPECT_GE(line->invariants().of(PartReason::parts_too_close), 2U);
}

TEST(PartsTooClose, parts_that_follow_too_close_are_rejected) {
    LineOptions options = timed_line(8, 100);
    options.cell.schedule.pitch_mm = 40;       // 80 ms on average,
    options.cell.schedule.pitch_jitter = 0.4;  // some below the 60 ms that are allowed
    const auto line = run_scenario(options);
    ASSERT_NE(line, nullptr);
    EXPECT_GT(line->invariants().of(PartReason::parts_too_close), 10U);
    EXPECT_GT(line->snapshot().counters.pass, 10U);
}

TEST(PartsTooClose, a_lost_edge_stops_the_line) {
    LineOptions options = timed_line(9, 100);
    options.cell.faults = {always(sim::InjectedFault::edge_lost, 40, 40)};
    const auto line = run_scenario(options);
    ASSERT_NE(line, nullptr);
    EXPECT_EQ(line->line_stops(), 1U);
    EXPECT_GE(line->snapshot().counters.missed, 1U);
}

}  // namespace
}  // namespace hord::lab
