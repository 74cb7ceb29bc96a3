// Copies and repeated exposures count once, parts that differ count as many.
#include "algo/good_parts/distinct_parts.h"

#include <gtest/gtest.h>

#include "tests/algo/good_parts/drawn_parts.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace testing;

constexpr std::uint32_t kDark = 6;

TEST(DistinctParts, copies_mirrored_and_turned_ones_too_are_one_part) {
    const Extents square{26, 26, 9, 9};
    const Frame one = noisy(drawn(square, 8, 200, lens(square, 10, 2)), {}, 1);
    DistinctParts distinct(square, 3);
    for (const Frame& frame : {one, one, mirrored(one), transposed(one), transposed(mirrored(one))})
        distinct.add(frame.view());
    const auto groups = distinct.groups();
    EXPECT_EQ(groups.parts, 1U);
    EXPECT_EQ(groups.copies, 4U);
    EXPECT_EQ(groups.exposures, 0U);
    EXPECT_EQ(describe(groups), "5 frames show 1 distinct part: 4 are copies of earlier ones. Each part counts once.");
}

TEST(DistinctParts, exposures_of_parts_that_were_not_moved_count_once_at_half_the_light_too) {
    DistinctParts distinct(kDrawn, kDark);
    std::uint64_t noise = 1;
    for (const double light : {1.0, 1.0, 0.7, 0.5}) {
        for (std::uint64_t seed = 1; seed <= 6; ++seed) {
            DrawnPart part = placed_part(seed);
            part.light = light, part.noise = ++noise;
            distinct.add(draw(part).view());
        }
    }
    const auto groups = distinct.groups();
    EXPECT_EQ(groups.parts, 6U);
    EXPECT_EQ(groups.exposures, 18U);
    for (std::size_t k = 0; k < groups.part_of.size(); ++k) EXPECT_EQ(groups.part_of[k], k % 6) << k;
}

TEST(DistinctParts, parts_in_other_poses_or_of_another_form_count_each) {
    DistinctParts placed(kDrawn, kDark), formed(kDrawn, kDark);
    for (std::uint64_t seed = 1; seed <= 30; ++seed) {
        placed.add(draw(placed_part(seed)).view());
        // All in one pose; curvature in steps of 1.5 %.
        formed.add(draw({.power = 0.08 * (1 + 0.015 * static_cast<double>(seed)), .noise = seed}).view());
    }
    EXPECT_EQ(placed.groups().parts, 30U);
    EXPECT_EQ(formed.groups().parts, 30U);
    EXPECT_EQ(describe(placed.groups()), "");
}

}  // namespace
}  // namespace hord::algo
