#include "tests/system/scenario/scenario.h"

namespace hord::lab {
namespace {

TEST(SensorGoesDark, dark_parts_are_rejected_and_repeated_darkness_stops_the_line) {
    for (auto* line_of : {&timed_line, &encoder_line}) {
        LineOptions options = line_of(2, 120);
        options.cell.faults = {always(sim::InjectedFault::frame_dark, 20, 29)};
        const auto line = run_scenario(options);
        ASSERT_NE(line, nullptr);
        EXPECT_GE(line->invariants().of(PartReason::too_dark), 5U);
        EXPECT_LE(line->invariants().of(PartReason::too_dark), 10U);
        EXPECT_GE(line->resets(), 1U);
        EXPECT_NE(line->snapshot().state, State::error);
        EXPECT_EQ(line->snapshot().faults_active, 0U);
    }
}

}  // namespace
}  // namespace hord::lab
