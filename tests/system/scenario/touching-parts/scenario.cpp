#include "tests/system/scenario/scenario.h"

namespace hord::lab {
namespace {

TEST(TouchingParts, stop_the_line_before_the_unseen_one_leaves) {
    for (auto* line_of : {&timed_line, &encoder_line}) {
        LineOptions options = line_of(14, 150);
        options.cell.faults = {always(sim::InjectedFault::part_touching, 30, 30),
                               always(sim::InjectedFault::part_touching, 80, 81)};
        const auto line = run_scenario(options);
        ASSERT_NE(line, nullptr);
        EXPECT_GE(line->line_stops(), 2U);
        EXPECT_EQ(line->cell().world().totals().left_bad, 0U);
        EXPECT_GE(line->snapshot().counters.missed, 2U);
    }
}

TEST(TouchingParts, a_missing_part_is_no_event_and_a_removed_one_costs_an_empty_pulse) {
    LineOptions options = timed_line(15, 150);
    options.cell.faults = {always(sim::InjectedFault::part_missing, 40, 44),
                           always(sim::InjectedFault::part_removed, 60, 60, milliseconds(100))};
    const auto line = run_scenario(options);
    ASSERT_NE(line, nullptr);
    EXPECT_EQ(line->line_stops(), 0U);
    EXPECT_EQ(line->invariants().of(PartReason::nothing_to_see), 1U);
    EXPECT_EQ(line->cell().world().totals().empty_pulses, 1U);
}

}  // namespace
}  // namespace hord::lab
