// Plates that moved while the light was on, or were exposed twice, judged against a reference.
#include <gtest/gtest.h>

#include "algo/reference/edge_blur.h"
#include "tests/algo/reference/drawn_plates.h"

namespace hord::algo {
namespace {

using namespace testing;

using Places = std::vector<std::pair<double, double>>;

// Evenly over so many lenslets.
Places moved(double lenslets, bool along_x) {
    Places places;
    for (int k = -8; k <= 8; ++k) {
        const double at = lenslets * k / 16;
        places.emplace_back(along_x ? at : 0, along_x ? 0 : at);
    }
    return places;
}
Places twice(double apart, bool along_x) {
    return along_x ? Places{{-apart / 2, 0}, {apart / 2, 0}} : Places{{0, -apart / 2}, {0, apart / 2}};
}

class MovedPlates : public ::testing::TestWithParam<PlateKind> {};

// They are unfit for another reason where they do not look like the reference's parts any more.
TEST_P(MovedPlates, do_not_pass_and_good_ones_are_not_blurred) {
    PlateCamera camera(85);
    auto pipeline = Pipeline::create(kPlates, kPlateBits, camera.learn(GetParam()));
    ASSERT_TRUE(pipeline) << pipeline.error().message();
    const auto judge = [&](const Places& places, double light) {
        PlateShot shot = camera.good();
        shot.light = light;
        shot.places = places;
        return pipeline->inspect(camera.expose(GetParam(), shot).view()).value();
    };
    int blurred = 0;
    for (const double light : {1.0, 0.25}) {
        for (int k = 0; k < 6; ++k) EXPECT_NE(judge({{0, 0}}, light).reason, Reason::unexpected_light) << light;
        for (const bool along_x : {true, false}) {
            for (const Places& places : {moved(3, along_x), moved(4, along_x), twice(2, along_x)}) {
                const Inspection seen = judge(places, light);
                EXPECT_NE(seen.verdict, Verdict::pass)
                    << light << (along_x ? " x " : " y ") << places.size() << " " << seen.registered.blur.blur[0] << " "
                    << seen.registered.blur.blur[1];
                const bool named = seen.frame.fault == FrameFault::blurred_edge;
                EXPECT_EQ(named, seen.registered.outcome == Registered::Outcome::blurred);
                blurred += named ? 1 : 0;
            }
        }
    }
    EXPECT_GE(blurred, 8) << "of 12";
}

// Only a step of the light by 8 % is at its outline.
TEST(MovedClearPlates, do_not_pass_and_good_ones_are_not_refused) {
    PlateCamera camera(86, 4);
    constexpr double kLight = 10;  // 20,000 electrons a lenslet
    const Recipe recipe = camera.learn(kClearPlate, 20, kLight);
    for (const float limit : recipe.reference->blur_limits) EXPECT_GT(limit, 0);
    for (const float limit : recipe.reference->size_limits) EXPECT_GT(limit, 0);
    auto pipeline = Pipeline::create(kPlates, kPlateBits, recipe);
    ASSERT_TRUE(pipeline) << pipeline.error().message();
    const auto judge = [&](const Places& places, double light) {
        PlateShot shot = camera.good();
        shot.light = light;
        shot.places = places;
        return pipeline->inspect(camera.expose(kClearPlate, shot).view()).value().registered;
    };
    for (const double light : {kLight, 0.25 * kLight}) {
        for (int k = 0; k < 6; ++k) EXPECT_TRUE(judge({{0, 0}}, light).found()) << light;
    }
    for (const bool along_x : {true, false}) {
        for (const Places& places : {moved(3, along_x), moved(4, along_x), twice(2, along_x), twice(3, along_x)})
            EXPECT_EQ(judge(places, kLight).outcome, Registered::Outcome::blurred) << along_x << " " << places.size();
    }
}

// Parts that lie alike show nothing of what the mean over a lenslet adds; the next part may show all of it.
TEST(BlurSpread, of_parts_that_lie_alike_allows_the_variance_of_a_lenslet) {
    BlurSpread spread;
    for (int k = 0; k < 20; ++k) {
        EdgeBlur blur;
        blur.known = {true, false};
        spread.add(blur);
    }
    EXPECT_FLOAT_EQ(spread.limits()[0], 1.0F / 12);
    EXPECT_EQ(spread.limits()[1], 0);
}

INSTANTIATE_TEST_SUITE_P(Bevels, MovedPlates, ::testing::Values(kDarkBevels, PlateKind{0.6, 1.5}));

}  // namespace
}  // namespace hord::algo
