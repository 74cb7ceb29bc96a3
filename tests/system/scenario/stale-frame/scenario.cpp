#include "tests/system/scenario/scenario.h"

namespace hord::lab {
namespace {

struct Case {
    sim::InjectedFault fault;
    PartReason reason;
};

TEST(StaleFrame, each_kind_of_wrong_frame_rejects_its_own_part_alone) {
    for (const Case& c : {Case{sim::InjectedFault::frame_stale, PartReason::frame_stale},
                          Case{sim::InjectedFault::frame_drop, PartReason::frame_lost},
                          Case{sim::InjectedFault::frame_late, PartReason::frame_lost},
                          Case{sim::InjectedFault::frame_short, PartReason::frame_short},
                          Case{sim::InjectedFault::frame_corrupt, PartReason::frame_corrupt}}) {
        LineOptions options = timed_line(4, 100);
        options.cell.faults = {always(c.fault, 10, 10), always(c.fault, 30, 30), always(c.fault, 50, 50)};
        const auto line = run_scenario(options);
        ASSERT_NE(line, nullptr);
        EXPECT_EQ(line->invariants().of(c.reason), 3U) << sim::name_of(c.fault);
        EXPECT_EQ(line->snapshot().counters.unfit, 3U) << sim::name_of(c.fault);
        EXPECT_EQ(line->line_stops(), 0U);
    }
}

TEST(StaleFrame, a_repeated_frame_harms_nobody_when_the_own_one_came) {
    LineOptions options = timed_line(5, 100);
    options.cell.faults = {always(sim::InjectedFault::frame_duplicate, 10, 30)};
    const auto line = run_scenario(options);
    ASSERT_NE(line, nullptr);
    EXPECT_EQ(line->snapshot().counters.unfit, 0U);
}

}  // namespace
}  // namespace hord::lab
