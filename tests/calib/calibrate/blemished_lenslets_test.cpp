// Dust on the array: a grain that hides a side of a lenslet moves its centre. Such a lenslet does not count, and its
// place is that of the grid.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/calib/support/synthetic.h"

namespace hord::calib {
namespace {

using test::White;

// Every 37th lenslet away from the border, where a lenslet is measured whole.
std::vector<test::TruePoint> some_lenslets(const White& white) {
    std::vector<test::TruePoint> out;
    const auto all = test::draw(white).truth;
    const double margin = 1.5 * white.pitch_px;
    for (std::size_t k = 10; k < all.size(); k += 37) {
        if (all[k].x > margin && all[k].y > margin && all[k].x < white.width_px - margin &&
            all[k].y < white.height_px - margin)
            out.push_back(all[k]);
    }
    return out;
}

TEST(BlemishedLenslets, do_not_count_and_have_the_place_of_the_grid) {
    for (const bool hexagonal : {false, true}) {
        for (const double spot : {0.0, -1.6, -2.5}) {
            for (const double depth : {0.3, 0.8}) {
                SCOPED_TRACE(::testing::Message() << hexagonal << ", spot " << -spot << ", depth " << depth);
                White white{.width_px = 500,
                            .height_px = 450,
                            .hexagonal = hexagonal,
                            .pitch_px = 17.3,
                            .rotation_deg = 2,
                            .disc_radius_px = spot};
                test::Random random(7);
                std::vector<test::TruePoint> grains = some_lenslets(white);
                for (test::TruePoint& grain : grains) {
                    const double angle = 6.283 * random.uniform(), far = spot < 0 ? -1.5 * spot : 0.3 * 17.3;
                    grain.x += far * std::cos(angle), grain.y += far * std::sin(angle);
                }
                white.light = [&](double x, double y) {
                    double light = 1;
                    for (const test::TruePoint& grain : grains) {
                        const double r = std::hypot(x - grain.x, y - grain.y) / 1.2;
                        light *= r < 6 ? 1 - depth * std::exp(-0.5 * r * r) : 1;
                    }
                    return light;
                };
                const auto drawn = test::draw(white);
                const auto calibration = calibrate_grid(drawn.frame.view());
                ASSERT_TRUE(calibration) << calibration.error().message();
                EXPECT_EQ(calibration->blemished, static_cast<int>(grains.size()));
                EXPECT_GE(calibration->rejected, calibration->blemished);
                EXPECT_EQ(calibration->displaced, 0);
                EXPECT_LT(test::compare(drawn, *calibration, white.pitch_px).max_px, 0.005);
                EXPECT_THAT(calibration->warnings, ::testing::IsEmpty());
            }
        }
    }
}

// Clean lenslets, also where distortion scales them and where their edges are sharp.
TEST(BlemishedLenslets, are_none_in_clean_frames) {
    for (const bool hexagonal : {false, true}) {
        for (const double k1 : {0.0, -0.05}) {
            for (const double edge : {0.3, 0.8, 2.0}) {
                for (const double peak : {800.0, 20'000.0}) {
                    SCOPED_TRACE(::testing::Message() << hexagonal << ", " << k1 << ", " << edge << ", " << peak);
                    const auto calibration = calibrate_grid(test::draw({.width_px = 500,
                                                                        .height_px = 450,
                                                                        .hexagonal = hexagonal,
                                                                        .pitch_px = 17.3,
                                                                        .rotation_deg = 2,
                                                                        .k1 = k1,
                                                                        .to_scale = true,
                                                                        .edge_px = edge,
                                                                        .peak_dn = peak})
                                                                .frame.view());
                    ASSERT_TRUE(calibration) << calibration.error().message();
                    EXPECT_EQ(calibration->blemished, 0);
                }
            }
        }
    }
}

}  // namespace
}  // namespace hord::calib
