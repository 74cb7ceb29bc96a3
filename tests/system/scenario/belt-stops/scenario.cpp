#include "tests/system/scenario/scenario.h"

namespace hord::lab {
namespace {

TEST(BeltStops, parts_keep_verdict_and_place) {
    using namespace std::chrono_literals;
    LineOptions options = encoder_line(12, 200);
    options.cell.conveyor.stops = {{3s, 1s}, {7130ms, 10s}, {19777ms, 50ms}};
    const auto line = run_scenario(options);
    ASSERT_NE(line, nullptr);
    EXPECT_EQ(line->snapshot().counters.seen, 200U);
    EXPECT_GT(line->snapshot().counters.pass, 150U);
    EXPECT_EQ(line->cell().world().totals().left_bad - line->snapshot().counters.reject_late -
                  line->snapshot().counters.reject_failed,
              0U);
}

}  // namespace
}  // namespace hord::lab
