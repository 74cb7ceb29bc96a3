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
    EXPECT_GE(placed.groups().at_least, 28U);
    EXPECT_EQ(formed.groups().parts, 30U);
    EXPECT_EQ(describe(placed.groups()), "");
}

// Exposures that could be parts that lie alike by chance are not joined, but a bound does not count them.
TEST(DistinctParts, exposures_that_hide_among_parts_that_lie_alike_are_not_counted_for_a_bound) {
    constexpr std::size_t kParts = 40, kAgain = 4;
    std::size_t hidden = 0;
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
        DistinctParts distinct(kDrawn, kDark);
        for (std::uint64_t k = 0; k < kParts + kAgain; ++k) {
            DrawnPart part = placed_part(1000 * seed + k % kParts);
            part.x *= 0.6, part.y *= 0.6;
            part.noise = 1000 * seed + k;
            distinct.add(draw(part).view());
        }
        const auto groups = distinct.groups();
        EXPECT_LE(groups.at_least, kParts) << seed;
        EXPECT_GE(groups.at_least, kParts / 2) << seed;
        EXPECT_LE(groups.at_least, groups.parts);
        hidden += groups.parts > kParts ? 1 : 0;
    }
    EXPECT_GT(hidden, 0U);
}

// A reference is learned from the first frame of each part, and only if they are enough.
TEST(DistinctParts, to_learn_from_are_the_first_frame_of_each) {
    LearnOptions options;
    options.levels.dark = kDark;
    const auto of_parts = [&](std::size_t parts, std::size_t count) {
        return parts_to_learn(
            kDrawn, count, [=](std::size_t k) -> Result<Frame> { return draw(placed_part(k % parts + 1)); }, options);
    };
    const auto enough = of_parts(8, 10);
    ASSERT_TRUE(enough) << enough.error().message();
    EXPECT_EQ(enough->frames, (std::vector<std::size_t>{0, 1, 2, 3, 4, 5, 6, 7}));
    EXPECT_EQ(enough->repeated,
              "10 frames show 8 distinct parts: 2 are copies of earlier ones. Each part counts once.");
    const auto few = of_parts(7, 10);
    ASSERT_FALSE(few);
    EXPECT_EQ(few.error().code, ErrorCode::invalid_argument);
    EXPECT_EQ(
        few.error().message(),
        "10 frames show 7 distinct parts: 3 are copies of earlier ones. Each part counts once. A reference needs 8 "
        "distinct good parts: give frames of at least 1 more, each of another part or of one that was placed anew");
    EXPECT_EQ(of_parts(7, 7).error().what, "7 frames to learn from. A reference needs 8 distinct good parts");
}

}  // namespace
}  // namespace hord::algo
