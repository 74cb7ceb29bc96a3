#include "tests/system/scenario/scenario.h"

namespace hord::lab {
namespace {

// The line's events are identical to those of a run without faults.
std::unique_ptr<SimulatedLine> run_undisturbed(LineOptions options) {
    auto line = run_scenario(options);
    options.cell.faults.clear();
    const auto quiet = run_scenario(options);
    if (line == nullptr || quiet == nullptr) return nullptr;
    const sim::WorldTotals& truth = line->cell().world().totals();
    EXPECT_EQ(line->snapshot().counters.unfit, 0U);
    EXPECT_EQ(truth.left_bad + truth.ejected_good, 0U);
    EXPECT_EQ(line->line_stops() + line->resets(), 0U);
    EXPECT_EQ(line->invariants().fingerprint(), quiet->invariants().fingerprint());
    EXPECT_EQ(line->invariants().undisturbed(), quiet->invariants().undisturbed());
    return line;
}

TEST(DiskAndClock, a_disk_in_trouble_costs_no_part_and_no_result) {
    for (const sim::InjectedFault fault : {sim::InjectedFault::store_error, sim::InjectedFault::store_in_doubt,
                                           sim::InjectedFault::store_slow, sim::InjectedFault::disk_full}) {
        for (auto* line_of : {&timed_line, &encoder_line}) {
            LineOptions options = line_of(31, 300);
            options.cell.faults = {always(fault, 50, 50, milliseconds(1500)),
                                   always(fault, 150, 151, milliseconds(300))};
            const auto line = run_undisturbed(options);
            ASSERT_NE(line, nullptr);
            EXPECT_EQ(line->store_observer().stored(), 300U) << sim::name_of(fault);
            EXPECT_EQ(line->store_observer().lost(), 0U);
        }
    }
}

TEST(DiskAndClock, what_memory_could_not_hold_is_named_in_the_store) {
    LineOptions options = timed_line(32, 300);
    options.cell.faults = {always(sim::InjectedFault::disk_full, 50, 50, milliseconds(6000))};
    const auto line = run_undisturbed(options);
    ASSERT_NE(line, nullptr);
    EXPECT_GT(line->store_observer().lost(), 10U);
    EXPECT_EQ(line->store_observer().stored() + line->store_observer().lost(), 300U);
}

TEST(DiskAndClock, a_clock_that_is_set_shows_in_the_records_and_nowhere_else) {
    for (auto* line_of : {&timed_line, &encoder_line}) {
        LineOptions options = line_of(33, 300);
        options.cell.faults = {always(sim::InjectedFault::clock_set, 40, 44, std::chrono::hours(1)),
                               always(sim::InjectedFault::clock_set, 140, 160, milliseconds(3))};
        const auto line = run_undisturbed(options);
        ASSERT_NE(line, nullptr);
        EXPECT_EQ(line->store_observer().stored(), 300U);
    }
}

}  // namespace
}  // namespace hord::lab
