// The variation of drawn parts whose only variation is known.
#include "algo/good_parts/variation.h"

#include <cmath>

#include <gtest/gtest.h>

#include "algo/reference/reference_learner.h"
#include "tests/algo/good_parts/drawn_parts.h"

namespace hord::algo {
namespace {

using namespace testing;

constexpr std::size_t kParts = 16;

TEST(Variation, the_first_mode_is_what_was_varied) {
    // The power of the lens alternates by 3 %; poses vary, too, and are taken out.
    const auto part = [](std::size_t k) {
        DrawnPart p = placed_part(k + 1);
        p.power *= k % 2 == 0 ? 1.03 : 0.97;
        return draw(p);
    };
    LearnOptions options;
    options.levels = {6, 60, 4095};
    options.electrons_per_dn = 1.0F, options.read_dn = 2;
    const auto learned = learn_reference(
        kDrawn, 12, kParts, [&](std::size_t k) -> Result<Frame> { return part(k); }, options);
    ASSERT_TRUE(learned);
    VariationMeter meter(learned->reference);
    for (std::size_t k = 0; k < kParts; ++k) {
        ASSERT_TRUE(learned->poses[k]) << k;
        meter.add(part(k).view(), *learned->poses[k]);
    }
    const Variation v = meter.finish(3);
    ASSERT_EQ(v.modes.size(), 3U);
    EXPECT_EQ(v.parts, kParts);
    EXPECT_GT(v.modes[0].share, 3 * v.share_by_noise());
    EXPECT_GT(v.modes[0].share, 2 * v.modes[1].share);
    // The parts alternate in it.
    for (std::size_t k = 2; k < kParts; ++k) EXPECT_GT(v.modes[0].amounts[k] * v.modes[0].amounts[k - 2], 0) << k;
    EXPECT_LT(v.modes[0].amounts[0] * v.modes[0].amounts[1], 0);
    // Its deflection along x is proportional to the place: 3 % of 0.08 bins a lenslet, up to the pose's part of it.
    const auto at = [&](int m, int n) { return std::abs(v.modes[0].maps.x[v.grid.index(m, n)]); };
    EXPECT_NEAR(static_cast<double>(at(22, 12)), 0.03 * 0.08 * 9.5, 0.01);
    EXPECT_LT(at(12, 12), at(22, 12) / 2);
    // Mean: the lens itself.
    EXPECT_NEAR(static_cast<double>(v.mean.x[v.grid.index(22, 12)]), 0.08 * 9.5, 0.05);
}

TEST(Variation, without_parts_is_empty) {
    Reference reference;
    reference.extents = kDrawn;
    EXPECT_TRUE(VariationMeter(reference).finish(3).modes.empty());
}

}  // namespace
}  // namespace hord::algo
