// Plates that lack glass, judged against a reference: holes, and chips at the outline, in which light is free.
#include <gtest/gtest.h>

#include "tests/algo/reference/drawn_plates.h"

namespace hord::algo {
namespace {

using namespace testing;

// Clear glass gives back 9 % of the light in a hole: four times the noise of a lenslet, twice in a quarter of the
// light.
TEST(DamagedPlates, with_a_hole_or_a_chip_in_clear_glass_are_rejected) {
    PlateCamera camera(76);
    auto pipeline = Pipeline::create(kPlates, kPlateBits, camera.learn(kClearPlate));
    ASSERT_TRUE(pipeline) << pipeline.error().message();
    const auto judge = [&](double x, double y, double radius, double light) {
        PlateShot shot = camera.good();
        shot.hole_x = x, shot.hole_y = y, shot.radius = radius, shot.light = light;
        return pipeline->inspect(camera.expose(kClearPlate, shot).view()).value();
    };
    int found = 0;  // in a quarter of the light
    for (int k = 0; k < 8; ++k) {
        for (const double light : {1.0, 0.25})
            EXPECT_NE(judge(0, 0, 0, light).reason, Reason::missing_material) << light << ": a good one";
        EXPECT_EQ(judge(10 * camera.uniform(), 7 * camera.uniform(), 2.2, 1).verdict, Verdict::reject) << k;
        found += judge(8 * camera.uniform(), 5 * camera.uniform(), 3, 0.25).verdict == Verdict::reject ? 1 : 0;
        EXPECT_EQ(judge(k % 2 == 0 ? kPlateHalfM : -kPlateHalfM, 7 * camera.uniform(), 4, 1).verdict, Verdict::reject)
            << k;
    }
    EXPECT_GE(found, 5) << "of 8";
    const Inspection hole = judge(4, -3, 2, 1);
    ASSERT_FALSE(hole.defects.empty());
    EXPECT_EQ(hole.reason, Reason::missing_material);
    EXPECT_NEAR(hole.defects[0].m, 34, 2);
    EXPECT_NEAR(hole.defects[0].n, 27, 2);
    EXPECT_NEAR(hole.defects[0].peak, 1 / 0.92 - 1, 0.04);
}

}  // namespace
}  // namespace hord::algo
