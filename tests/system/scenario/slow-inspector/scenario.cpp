#include "tests/system/scenario/scenario.h"

namespace hord::lab {
namespace {

TEST(SlowInspector, late_verdicts_reject) {
    LineOptions options = timed_line(10, 150);
    options.core.max_failures_in_a_row = 0;
    options.cell.faults = {always(sim::InjectedFault::inspector_slow, 30, 49, milliseconds(880))};
    options.queue = 64;
    options.cell.sensor.buffers = 64;
    const auto line = run_scenario(options);
    ASSERT_NE(line, nullptr);
    EXPECT_EQ(line->cell().faults().fired(sim::InjectedFault::inspector_slow), 20U);
    EXPECT_EQ(line->invariants().of(PartReason::verdict_late), 20U);
    EXPECT_EQ(line->snapshot().counters.unfit, 20U);
    EXPECT_NE(line->snapshot().faults_latched & kFaultOverrun, 0U);
    EXPECT_EQ(line->line_stops(), 0U);
}

TEST(SlowInspector, a_full_queue_rejects) {
    LineOptions options = timed_line(11, 150);
    options.core.max_failures_in_a_row = 0;
    options.cell.faults = {always(sim::InjectedFault::inspector_slow, 30, 49, milliseconds(880))};
    options.queue = 2;
    options.cell.sensor.buffers = 64;
    const auto line = run_scenario(options);
    ASSERT_NE(line, nullptr);
    EXPECT_GT(line->invariants().of(PartReason::inspector_failed), 5U);
    EXPECT_GT(line->invariants().of(PartReason::verdict_late), 0U);
}

}  // namespace
}  // namespace hord::lab
