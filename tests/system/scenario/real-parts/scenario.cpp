#include "tests/system/scenario/scenario.h"

#include "lab/soak/real_parts.h"

namespace hord::lab {
namespace {

LineOptions real_line(LineOptions options) {
    if (const auto shown = show_real_parts(options); !shown) ADD_FAILURE() << shown.error().message();
    return options;
}

TEST(RealParts, are_judged_by_the_real_pipeline_and_leave_by_the_right_way) {
    for (auto* line_of : {&timed_line, &encoder_line}) {
        const auto line = run_scenario(real_line(line_of(5, 150)));
        ASSERT_NE(line, nullptr);
        const Snapshot s = line->snapshot();
        const sim::WorldTotals& truth = line->cell().world().totals();
        EXPECT_EQ(s.counters.inspected, 150U);
        EXPECT_GT(s.counters.reject, 5U);
        EXPECT_EQ(truth.ejected_bad, s.counters.reject);
        EXPECT_EQ(truth.left_good, s.counters.pass);
        EXPECT_EQ(truth.left_bad + truth.ejected_good, 0U);
        EXPECT_EQ(s.faults_latched, 0U);
    }
}

TEST(RealParts, under_faulty_light_are_unfit_and_never_passed) {
    LineOptions options = real_line(timed_line(6, 150));
    options.cell.faults = {
        always(sim::InjectedFault::strobe_dead, 20, 21), always(sim::InjectedFault::frame_dark, 40, 41),
        always(sim::InjectedFault::frame_saturated, 60, 61), always(sim::InjectedFault::frame_stale, 80, 80),
        always(sim::InjectedFault::strobe_weak, 100, 101)};
    const auto line = run_scenario(options);
    ASSERT_NE(line, nullptr);
    EXPECT_GE(line->invariants().of(PartReason::too_dark), 4U);
    EXPECT_GE(line->invariants().of(PartReason::saturated), 2U);
    EXPECT_EQ(line->invariants().passed_bad(), 0U);
    EXPECT_EQ(line->cell().world().totals().left_bad, 0U);
}

}  // namespace
}  // namespace hord::lab
