#include "tests/system/scenario/scenario.h"

namespace hord::lab {
namespace {

TEST(DevicesLost, the_station_finds_back) {
    for (const sim::InjectedFault fault :
         {sim::InjectedFault::part_sensor_lost, sim::InjectedFault::strobe_lost, sim::InjectedFault::sensor_lost}) {
        for (auto* line_of : {&timed_line, &encoder_line}) {
            LineOptions options = line_of(13, 150);
            options.cell.faults = {always(fault, 40, 40), always(fault, 80, 80, milliseconds(1700))};
            const auto line = run_scenario(options);
            ASSERT_NE(line, nullptr);
            EXPECT_GE(line->resets(), 2U) << sim::name_of(fault);
            EXPECT_EQ(line->snapshot().state, State::continuous_execution) << sim::name_of(fault);
            EXPECT_EQ(line->snapshot().faults_active, 0U) << sim::name_of(fault);
        }
    }
}

}  // namespace
}  // namespace hord::lab
