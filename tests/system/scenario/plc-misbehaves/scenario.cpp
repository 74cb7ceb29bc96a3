#include "tests/system/scenario/scenario.h"

namespace hord::lab {
namespace {

TEST(PlcMisbehaves, commands_are_carried_out_once_and_the_line_finds_back) {
    for (const PlcPolicy policy : {PlcPolicy::none, PlcPolicy::stop, PlcPolicy::reject_all}) {
        for (auto* line_of : {&timed_line, &encoder_line}) {
            LineOptions options = line_of(16, 300);
            options.core.plc_policy = policy;
            options.cell.faults = {
                always(sim::InjectedFault::plc_repeats, 20, 22),    always(sim::InjectedFault::plc_nonsense, 40, 42),
                always(sim::InjectedFault::scada_floods, 50, 60),   always(sim::InjectedFault::plc_commands, 80, 80),
                always(sim::InjectedFault::plc_commands, 120, 120), always(sim::InjectedFault::plc_silent, 160, 160)};
            const auto line = run_scenario(options);
            ASSERT_NE(line, nullptr);
            EXPECT_EQ(line->snapshot().state, State::continuous_execution);
            EXPECT_EQ(line->invariants().of(PartReason::plc_lost) > 0, policy == PlcPolicy::reject_all);
        }
    }
}

}  // namespace
}  // namespace hord::lab
