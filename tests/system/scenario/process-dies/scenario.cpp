#include "tests/system/scenario/scenario.h"

namespace hord::lab {
namespace {

TEST(ProcessDies, at_any_point_and_no_part_leaves_unjudged) {
    for (std::uint64_t seed = 1; seed <= 12; ++seed) {
        for (auto* line_of : {&timed_line, &encoder_line}) {
            LineOptions options = line_of(seed, 120);
            options.cell.faults = {always(sim::InjectedFault::process_crash, 20, 20),
                                   always(sim::InjectedFault::process_crash, 60, 60, milliseconds(2000))};
            const auto line = run_scenario(options);
            ASSERT_NE(line, nullptr);
            EXPECT_EQ(line->processes(), 3U);
            EXPECT_GE(line->line_stops(), 2U);
            EXPECT_GT(line->cell().world().totals().removed, 0U);
            EXPECT_EQ(line->cell().world().totals().left_bad, 0U);
            EXPECT_EQ(line->snapshot().state, State::continuous_execution);
        }
    }
}

TEST(ProcessDies, restarted_in_order_with_another_configuration) {
    for (auto* line_of : {&timed_line, &encoder_line}) {
        LineOptions options = line_of(3, 150);
        options.cell.faults = {always(sim::InjectedFault::restart_ordered, 30, 30),
                               always(sim::InjectedFault::restart_ordered, 90, 90)};
        const auto line = run_scenario(options);
        ASSERT_NE(line, nullptr);
        EXPECT_EQ(line->processes(), 3U);
        EXPECT_EQ(line->cell().world().totals().left_bad, 0U);
    }
}

}  // namespace
}  // namespace hord::lab
