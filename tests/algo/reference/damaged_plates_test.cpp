// Plates that lack glass, judged against a reference: holes, and chips at the outline, in which light is free.
#include <gtest/gtest.h>

#include "tests/algo/reference/drawn_plates.h"

namespace hord::algo {
namespace {

using namespace testing;

// Free light that enters through a bite leaves no outline of the frame's own: the reference says where the part lies.
TEST(DamagedPlates, with_a_bite_are_judged_by_the_references_outline) {
    PlateCamera camera(75);
    const Recipe recipe = camera.learn(kBentBevels);
    auto pipeline = Pipeline::create(kPlates, kPlateBits, recipe);
    ASSERT_TRUE(pipeline) << pipeline.error().message();
    for (int k = 0; k < 32; ++k) {
        PlateShot shot = camera.good();
        const int side = k % 2 == 0 ? 1 : -1;
        shot.radius = k < 16 ? 2.5 : 3.5;
        if (k % 4 < 2) shot.hole_x = side * kPlateHalfM, shot.hole_y = 8 * camera.uniform();
        else shot.hole_x = 11 * camera.uniform(), shot.hole_y = side * kPlateHalfN;
        const auto seen = pipeline->inspect(camera.expose(kBentBevels, shot).view());
        ASSERT_TRUE(seen);
        EXPECT_NE(seen->verdict, Verdict::pass) << k;
        EXPECT_NE(seen->reason, Reason::nothing_to_see) << k;
        EXPECT_GT(seen->lenslets.judged, 345U) << k << ": half of the plate";
    }
}

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
