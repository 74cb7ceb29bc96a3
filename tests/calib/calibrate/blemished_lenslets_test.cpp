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

// A square lenslet without one of its corners is more like the profile, which is round; but not like itself turned.
TEST(BlemishedLenslets, that_lost_a_corner_have_the_place_of_the_grid) {
    for (const double turn : {0.0, 3.0}) {
        for (const double radius : {1.6, 2.0, 2.6}) {
            SCOPED_TRACE(::testing::Message() << turn << " degrees, " << radius);
            White white{.width_px = 400,
                        .height_px = 360,
                        .pitch_px = 24,
                        .rotation_deg = turn,
                        .offset_x_px = 8.4,
                        .offset_y_px = 8.7,
                        .disc_radius_px = 6.9,
                        .edge_px = 1,
                        .square = true,
                        .subpixels = 3,
                        .peak_dn = 216.75,
                        .background_dn = 2,
                        .electrons_per_dn = 39,
                        .bits = 8};
            std::vector<test::TruePoint> grains = some_lenslets(white);
            int corner = 0;
            for (test::TruePoint& grain : grains) {
                grain.x += corner % 2 == 0 ? 4.1 : -4.1;
                grain.y += ++corner % 4 < 2 ? 5.9 : -5.9;
            }
            white.light = [&](double x, double y) {
                double light = 1;
                for (const test::TruePoint& at : grains)
                    light *= 1 - 0.8 * std::clamp(radius + 0.5 - std::hypot(x - at.x, y - at.y), 0.0, 1.0);
                return light;
            };
            const auto drawn = test::draw(white);
            const auto calibration = calibrate_grid(drawn.frame.view());
            ASSERT_TRUE(calibration) << calibration.error().message();
            EXPECT_EQ(calibration->blemished, static_cast<int>(grains.size()));
            EXPECT_LT(test::compare(drawn, *calibration, white.pitch_px).max_px, 0.02);
        }
    }
}

// Each lenslet is off its place, so that its light is judged. A grain that is brighter on one side than the lenslet and
// darker on the other leaves its mean; a lenslet that is dim all over keeps its shape.
TEST(BlemishedLenslets, differ_in_shape_and_not_in_level) {
    for (const bool hexagonal : {false, true}) {
        SCOPED_TRACE(hexagonal);
        White white{.width_px = 500, .height_px = 450, .hexagonal = hexagonal, .pitch_px = 17.3, .rotation_deg = 2};
        const std::vector<test::TruePoint> some = some_lenslets(white);
        const auto nearest = [&](double x, double y) {
            return *std::ranges::min_element(some, {},
                                             [=](const test::TruePoint& at) { return std::hypot(x - at.x, y - at.y); });
        };
        white.deflect = [&](double x, double y) {
            const test::TruePoint at = nearest(x, y);
            return std::pair(std::hypot(x - at.x, y - at.y) < 1 ? 0.3 : 0.0, 0.0);
        };
        White level = white, shape = white;
        level.light = [&](double x, double y) {
            const test::TruePoint at = nearest(x, y);
            return std::hypot(x - at.x, y - at.y) < 8.6 ? 0.6 : 1;
        };
        shape.light = [&](double x, double y) {
            const test::TruePoint at = nearest(x, y);
            const double dx = x - at.x - 0.3, dy = y - at.y, r = std::hypot(dx, dy) / 3;
            return r < 3 ? 1 + 0.5 * dx / 3 * std::exp(-0.5 * r * r) : 1;
        };
        const auto dim = calibrate_grid(test::draw(level).frame.view());
        ASSERT_TRUE(dim) << dim.error().message();
        EXPECT_EQ(dim->blemished, 0);
        EXPECT_EQ(dim->displaced, static_cast<int>(some.size()));
        const auto stained = calibrate_grid(test::draw(shape).frame.view());
        ASSERT_TRUE(stained) << stained.error().message();
        EXPECT_EQ(stained->blemished, static_cast<int>(some.size()));
        for (const Observation& seen : stained->observations) {
            if (seen.blemished) {
                EXPECT_NEAR(seen.light_dn, stained->observations.front().light_dn, 0.05 * seen.light_dn);
            }
        }
    }
}

// The light of a dead lenslet is the rounding of sums: quotients of it must not count where the profile is learned.
TEST(BlemishedLenslets, dead_ones_in_the_middle_do_not_matter) {
    for (const double offset : {0.3, 2.4, 4.1, 5.6, 7.0, 8.4, 9.9, 11.3}) {
        for (const std::size_t dead : {1, 2, 3}) {
            SCOPED_TRACE(::testing::Message() << offset << " px, " << dead);
            White white{.width_px = 300,
                        .height_px = 260,
                        .pitch_px = 24,
                        .offset_x_px = offset,
                        .offset_y_px = offset + 0.3,
                        .disc_radius_px = 6.9,
                        .edge_px = 0.6,
                        .square = true,
                        .subpixels = 3,
                        .peak_dn = 216.75,
                        .background_dn = 2,
                        .noise = false,
                        .bits = 8};
            auto near = test::draw(white).truth;
            const auto far = [](const test::TruePoint& at) { return std::hypot(at.x - 149.5, at.y - 129.5); };
            std::ranges::sort(near, {}, far);
            white.light = [&](double x, double y) {
                for (std::size_t k = 0; k < dead; ++k) {
                    if (std::hypot(x - near[3 * k].x, y - near[3 * k].y) < 12) return 0.0;
                }
                return 1.0;
            };
            const auto drawn = test::draw(white);
            const auto calibration = calibrate_grid(drawn.frame.view());
            ASSERT_TRUE(calibration) << calibration.error().message();
            EXPECT_EQ(calibration->missing, static_cast<int>(dead));
            EXPECT_LT(test::compare(drawn, *calibration, white.pitch_px).max_px, 0.02);
        }
    }
}

// Where the light ends, lenslets are lit in part: their shape says nothing about dust.
TEST(BlemishedLenslets, are_none_at_the_edge_of_the_light) {
    for (const double spot : {0.0, -2.5}) {
        SCOPED_TRACE(spot);
        White white{.width_px = 500, .height_px = 450, .pitch_px = 17.3, .rotation_deg = 2, .disc_radius_px = spot};
        white.light = [](double x, double y) { return std::hypot(x - 240, y - 220) < 170 ? 1.0 : 0.0; };
        const auto calibration = calibrate_grid(test::draw(white).frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        EXPECT_EQ(calibration->blemished, 0);
        EXPECT_GT(calibration->rejected, 0);
    }
}

// Clean lenslets, also where distortion scales them and where their edges are sharp.
TEST(BlemishedLenslets, are_none_in_clean_frames) {
    for (const double pitch : {17.3, 24.0}) {
        for (const double edge : {1.0, 1.5}) {
            SCOPED_TRACE(::testing::Message() << "squares of " << pitch << ", " << edge);
            const auto calibration = calibrate_grid(test::draw({.width_px = 500,
                                                                .height_px = 450,
                                                                .pitch_px = pitch,
                                                                .rotation_deg = 2,
                                                                .disc_radius_px = 0.36 * pitch,
                                                                .edge_px = edge,
                                                                .square = true,
                                                                .subpixels = 3,
                                                                .misplaced_px = 0.005 * pitch,
                                                                .peak_dn = 800})
                                                        .frame.view());
            ASSERT_TRUE(calibration) << calibration.error().message();
            EXPECT_EQ(calibration->blemished, 0);
        }
    }
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
