#include "tests/system/scenario/scenario.h"

namespace hord::lab {
namespace {

void expect_a_sunny_day(const LineOptions& options) {
    const auto line = run_scenario(options);
    ASSERT_NE(line, nullptr);
    const Snapshot s = line->snapshot();
    const sim::WorldTotals& truth = line->cell().world().totals();
    EXPECT_EQ(s.counters.seen, 200U);
    EXPECT_EQ(s.counters.inspected, 200U);
    EXPECT_EQ(s.counters.unfit, 0U);
    EXPECT_GT(s.counters.reject, 5U);
    EXPECT_EQ(s.counters.reject_confirmed, s.counters.reject);
    EXPECT_EQ(truth.ejected_bad, s.counters.reject);
    EXPECT_EQ(truth.left_good, s.counters.pass);
    EXPECT_EQ(truth.left_bad + truth.ejected_good + truth.empty_pulses, 0U);
    EXPECT_EQ(s.faults_latched, 0U);
    EXPECT_EQ(line->line_stops() + line->resets(), 0U);
}

TEST(SunnyDay, on_a_line_of_constant_speed) { expect_a_sunny_day(timed_line(1, 200)); }
TEST(SunnyDay, on_a_line_followed_by_an_encoder) { expect_a_sunny_day(encoder_line(1, 200)); }

}  // namespace
}  // namespace hord::lab
