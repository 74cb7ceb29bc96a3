#include "firmware/soak/pipeline_pool.h"
#include "tests/scenario/scenario.h"

namespace hord::firmware {
namespace {

class RealPipeline : public ::testing::Test {
  protected:
    static const PipelinePool& pool() {
        static const auto made = PipelinePool::make();
        EXPECT_TRUE(made) << made.error().message();
        return **made;
    }
};

TEST_F(RealPipeline, specks_are_ejected_and_clear_parts_pass) {
    LineOptions options = timed_line(21, 80);
    pool().equip(options);
    const auto line = run_scenario(options);
    ASSERT_NE(line, nullptr);
    const auto& totals = line->cell().world().totals();
    EXPECT_GT(totals.ejected_bad, 0U);
    EXPECT_EQ(totals.left_bad, 0U);
    EXPECT_EQ(totals.ejected_good, 0U);
    EXPECT_EQ(line->invariants().of(PartReason::absorption), totals.ejected_bad);
}

TEST_F(RealPipeline, frames_that_are_wrong_pass_nothing) {
    LineOptions options = encoder_line(22, 120);
    pool().equip(options);
    for (const sim::Fault fault : {sim::Fault::frame_dark, sim::Fault::frame_saturated, sim::Fault::frame_stale, sim::Fault::strobe_dead}) {
        options.cell.faults.push_back(always(fault, 20 + 15 * static_cast<std::uint64_t>(fault) % 60, 22 + 15 * static_cast<std::uint64_t>(fault) % 60));
    }
    const auto line = run_scenario(options);
    ASSERT_NE(line, nullptr);
    EXPECT_EQ(line->cell().world().totals().left_bad, 0U);
    EXPECT_GE(line->snapshot().counters.unfit, 8U);
}

}  // namespace
}  // namespace hord::firmware
