#include "lab/optics/truth.h"

#include <algorithm>

#include <gtest/gtest.h>

namespace hord::lab {
namespace {

using namespace sim;

TEST(Truth, says_where_each_defect_is_seen) {
    Scene scene;
    scene.part = DoubleConvexLens{};
    EXPECT_TRUE(truth_of(scene).defect_free);
    scene.defects = {AirBubble{{2, -3, 0}, 0.5}, AbsorbingSpeck{{-3, 4, 0}, 0.4, 0}, AirBubble{{0, 30, 0}, 0.5}};
    scene.pose = {1, 0, 0};
    const Truth truth = truth_of(scene);
    EXPECT_FALSE(truth.defect_free);
    ASSERT_EQ(truth.defects.size(), 2U);  // the third is outside the part and has no effect
    const double pitch = 24.0 / 111;
    EXPECT_STREQ(truth.defects[0].kind, "bubble");
    EXPECT_NEAR(truth.defects[0].m, 55 + 3 / pitch, 0.2);
    EXPECT_NEAR(truth.defects[0].n, 55 - 3 / pitch, 0.2);
    EXPECT_NEAR(truth.defects[0].radius_lenslets, 0.5 / pitch, 0.1);
    EXPECT_STREQ(truth.defects[1].kind, "speck");
    EXPECT_NEAR(truth.defects[1].m, 55 - 2 / pitch, 0.2);
    EXPECT_NEAR(truth.defects[1].n, 55 + 4 / pitch, 0.2);
    const auto label = [&](int m, int n) { return truth.labels[static_cast<std::size_t>(n * 111 + m)]; };
    EXPECT_EQ(label(69, 41), 3);
    EXPECT_EQ(label(60, 55), 1);
    EXPECT_EQ(label(2, 2), 0);
    EXPECT_EQ(label(13, 55), 2);  // the left rim, one millimetre to the right
    const auto count = static_cast<std::uint32_t>(std::count(truth.labels.begin(), truth.labels.end(), 3));
    EXPECT_EQ(count, truth.defects[0].area_lenslets + truth.defects[1].area_lenslets);
}

TEST(Truth, a_bubble_smaller_than_a_lenslet_is_not_overlooked) {
    Scene scene;
    scene.part = DoubleConvexLens{};
    scene.defects = {AirBubble{{0.3, 0.2, -1}, 0.005}};
    const Truth truth = truth_of(scene);
    ASSERT_EQ(truth.defects.size(), 1U);
    EXPECT_EQ(truth.defects[0].area_lenslets, 1U);
    EXPECT_NEAR(truth.defects[0].radius_lenslets, 0.005 / (24.0 / 111), 0.002);
}

TEST(Truth, names_a_defect_as_the_scene_file_does) {
    Scene scene;
    scene.part = Plate{};
    scene.defects = {Absorber{{0, 0, 0}, 0.5, true}};
    EXPECT_STREQ(truth_of(scene).defects.at(0).kind, "absorber");
}

}  // namespace
}  // namespace hord::lab
