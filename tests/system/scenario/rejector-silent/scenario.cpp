#include "tests/system/scenario/scenario.h"

namespace hord::lab {
namespace {

void expect_line_stop(sim::InjectedFault fault) {
    for (auto* line_of : {&timed_line, &encoder_line}) {
        LineOptions options = line_of(3, 200);
        options.cell.faults = {always(fault, 4, 6)};
        const auto line = run_scenario(options);
        ASSERT_NE(line, nullptr);
        EXPECT_GE(line->line_stops(), 1U) << sim::name_of(fault);
        EXPECT_GE(line->snapshot().counters.reject_failed + line->snapshot().counters.reject_late, 1U);
        EXPECT_EQ(line->snapshot().state, State::continuous_execution);
        EXPECT_FALSE(line->snapshot().line_stop);
    }
}

TEST(RejectorSilent, a_lost_command_stops_the_line) { expect_line_stop(sim::InjectedFault::reject_lost); }
TEST(RejectorSilent, a_missing_acknowledgement_stops_the_line) {
    expect_line_stop(sim::InjectedFault::reject_unacknowledged);
}
TEST(RejectorSilent, a_late_pulse_stops_the_line) { expect_line_stop(sim::InjectedFault::reject_late); }
TEST(RejectorSilent, a_lost_link_stops_the_line) { expect_line_stop(sim::InjectedFault::rejector_down); }

}  // namespace
}  // namespace hord::lab
