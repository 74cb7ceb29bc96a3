// Lenslets that are darker than their neighbours: single ones, and whole rows.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/calib/support/synthetic.h"

namespace hord::calib {
namespace {

using test::White;

// Noise and the light of their neighbours move the centres of dim lenslets. That is no place of their own.
TEST(DimLenslets, have_the_place_of_the_grid) {
    for (const bool hexagonal : {false, true}) {
        for (const double pitch : {10.4, 12.0, 15.0, 17.26}) {
            for (const std::uint64_t seed : {1, 2, 3, 4}) {
                SCOPED_TRACE(::testing::Message() << hexagonal << ", " << pitch << ", " << seed);
                White white{.width_px = static_cast<int>(20 * pitch),
                            .height_px = static_cast<int>(18 * pitch),
                            .hexagonal = hexagonal,
                            .pitch_px = pitch,
                            .rotation_deg = seed == 2 ? 0.57 : 0,
                            .disc_radius_px = 0.45 * pitch,
                            .edge_px = 1.2,
                            .peak_dn = 190,
                            .background_dn = 2,
                            .electrons_per_dn = 10,
                            .read_e = 6,
                            .seed = seed,
                            .bits = 8};
                test::Random random(seed);
                white.own_light = [&](double x, double y) {
                    const double border = std::min({x, y, white.width_px - x, white.height_px - y});
                    const double light = 0.05 + 0.55 * random.uniform();
                    return random.uniform() < 0.05 && border > pitch ? light : 1.0;
                };
                const auto drawn = test::draw(white);
                const auto calibration = calibrate_grid(drawn.frame.view());
                ASSERT_TRUE(calibration) << calibration.error().message();
                EXPECT_LT(test::compare(drawn, *calibration, pitch).max_px, 0.1);
            }
        }
    }
}

// A row of lenslets that is dark as a whole is alike along itself, and less so from row to row.
TEST(DimLenslets, may_be_a_row) {
    for (const bool hexagonal : {false, true}) {
        for (const double light : {0.0, 0.1, 0.5}) {
            SCOPED_TRACE(::testing::Message() << hexagonal << ", " << light);
            White white{.width_px = 300,
                        .height_px = 276,
                        .hexagonal = hexagonal,
                        .pitch_px = 12,
                        .disc_radius_px = 5.1,
                        .peak_dn = 190,
                        .background_dn = 2,
                        .electrons_per_dn = 10,
                        .read_e = 6,
                        .bits = 8};
            white.own_light = [&](double, double y) { return std::abs(y - 137.1) < 4 ? light : 1.0; };
            const auto drawn = test::draw(white);
            const auto calibration = calibrate_grid(drawn.frame.view());
            ASSERT_TRUE(calibration) << calibration.error().message();
            EXPECT_LT(test::compare(drawn, *calibration, white.pitch_px).max_px, 0.05);
        }
    }
}

// Their gaps are less deep than the row.
TEST(DimLenslets, of_a_dark_row_do_not_hide_a_lattice_with_soft_edges) {
    for (const double pitch : {9.7, 11.9, 13.8}) {
        for (const double edge : {0.8, 1.2}) {
            SCOPED_TRACE(::testing::Message() << pitch << " px, edge " << edge);
            White white{.width_px = static_cast<int>(26 * pitch),
                        .height_px = static_cast<int>(26 * pitch),
                        .hexagonal = true,
                        .pitch_px = pitch,
                        .disc_radius_px = 0.45 * pitch,
                        .edge_px = edge};
            const double middle = 13 * pitch - 0.9;
            white.own_light = [&](double, double y) { return std::abs(y - middle) < pitch / 3 ? 0.0 : 1.0; };
            const auto calibration = calibrate_grid(test::draw(white).frame.view());
            ASSERT_TRUE(calibration) << calibration.error().message();
            EXPECT_NEAR(calibration->pitch_px, pitch, 0.01);
            EXPECT_GE(calibration->missing, 20);
        }
    }
}

// Squares are measured in a smoothed frame, where the halves of a lenslet share noise: they agree on it. Its centre is
// not off by that, and no lenslet has a place of its own.
TEST(DimLenslets, noise_that_halves_share_is_no_place_of_their_own) {
    double common = 0, noise = 0;  // sums of r^2 - d^2 and of d^2: of centres off the grid, of differences of halves
    for (const double electrons : {60.0, 120.0}) {
        for (const double pitch : {12.6, 15.0, 17.3, 20.4}) {
            for (const std::uint64_t seed : {1, 2, 3}) {
                SCOPED_TRACE(::testing::Message() << electrons << " e, " << pitch << ", " << seed);
                const White white{.width_px = static_cast<int>(24 * pitch),
                                  .height_px = static_cast<int>(22 * pitch),
                                  .pitch_px = pitch,
                                  .rotation_deg = seed == 2 ? 1.3 : 0,
                                  .disc_radius_px = 0.4 * pitch,
                                  .edge_px = 2.4,
                                  .square = true,
                                  .subpixels = 2,
                                  .peak_dn = 10 * electrons,
                                  .background_dn = 20,
                                  .electrons_per_dn = 0.1,
                                  .read_e = 5,
                                  .seed = seed,
                                  .bits = 12};
                const auto drawn = test::draw(white);
                const auto calibration = calibrate_grid(drawn.frame.view());
                ASSERT_TRUE(calibration) << calibration.error().message();
                EXPECT_EQ(calibration->fit.shifts.share, 0) << calibration->fit.reason;
                EXPECT_LT(test::compare(drawn, *calibration, white.pitch_px).max_px, 0.1);
                for (const Observation& seen : calibration->observations) {
                    if (!seen.used || !seen.split_px) continue;
                    const algo::PixelPoint at = calibration->fit.grid.centre_px(seen.m, seen.n);
                    const double dx = seen.centre_px.x_px - at.x_px, dy = seen.centre_px.y_px - at.y_px;
                    const double of_halves = std::pow(seen.split_px->x_px, 2) + std::pow(seen.split_px->y_px, 2);
                    common += dx * dx + dy * dy - of_halves;
                    noise += of_halves;
                }
            }
        }
    }
    // Its standard error is 0.01: 2 / sqrt(2 n) for n = 9,000 lenslets along two axes.
    EXPECT_LT(common, 0.05 * noise);
}

// The light of a lenslet is known to its noise. That is no dirt; where there is some, it is told as before.
TEST(DimLenslets, noise_is_no_uneven_light) {
    for (const bool square : {false, true}) {
        for (const double uneven : {0.0, 0.15}) {
            SCOPED_TRACE(::testing::Message() << square << ", " << uneven);
            const double pitch = square ? 13.0 : 8.7;
            White white{.width_px = static_cast<int>(36 * pitch),
                        .height_px = static_cast<int>(34 * pitch),
                        .pitch_px = pitch,
                        .rotation_deg = 1,
                        .disc_radius_px = 0.4 * pitch,
                        .edge_px = square ? 1.5 : 0.7,
                        .square = square,
                        .subpixels = 2,
                        .peak_dn = square ? 450.0 : 700.0,
                        .background_dn = 20,
                        .electrons_per_dn = 0.1,
                        .read_e = 5,
                        .bits = 12};
            test::Random random(1);
            white.own_light = [&](double, double) { return 1 + uneven * random.normal(); };
            const auto calibration = calibrate_grid(test::draw(white).frame.view());
            ASSERT_TRUE(calibration) << calibration.error().message();
            if (uneven == 0) EXPECT_THAT(calibration->warnings, ::testing::IsEmpty());
            else EXPECT_THAT(calibration->warnings, ::testing::Contains(::testing::HasSubstr("the light differs by")));
        }
    }
}

// Misplaced squares that nearly touch lie in the light of their neighbours, and change it: they do not follow it.
TEST(DimLenslets, misplaced_squares_do_not_follow_the_light) {
    for (const double pitch : {9.3, 10.7}) {
        const auto drawn = test::draw({.width_px = 318,
                                       .height_px = 260,
                                       .pitch_px = pitch,
                                       .rotation_deg = 0.7,
                                       .disc_radius_px = 0.43 * pitch,
                                       .edge_px = 2,
                                       .square = true,
                                       .subpixels = 3,
                                       .misplaced_px = 0.053});
        const auto calibration = calibrate_grid(drawn.frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        EXPECT_GT(calibration->light_following.share, 0.3);
        EXPECT_THAT(calibration->warnings,
                    ::testing::Not(::testing::Contains(::testing::HasSubstr("follow the light"))));
    }
}

// Where lenslets nearly touch, a dark one moves its neighbours: these are off the grid, and the grid is right.
TEST(DimLenslets, that_move_their_neighbours_are_no_reason_for_a_warning) {
    int moved = 0;
    for (const double radius : {0.38, 0.41}) {
        for (const std::uint64_t seed : {1, 2, 3, 4, 5, 6}) {
            SCOPED_TRACE(::testing::Message() << radius << ", " << seed);
            const White white{.width_px = 282,
                              .height_px = 303,
                              .hexagonal = true,
                              .pitch_px = 10.4,
                              .disc_radius_px = radius * 10.4,
                              .edge_px = 1.4,
                              .dead_share = 0.02,
                              .seed = seed};
            const auto drawn = test::draw(white);
            const auto calibration = calibrate_grid(drawn.frame.view());
            ASSERT_TRUE(calibration) << calibration.error().message();
            moved += calibration->beside_missing;
            EXPECT_THAT(calibration->warnings, ::testing::IsEmpty());
            EXPECT_LT(test::compare(drawn, *calibration, white.pitch_px).rms_px, 0.01);
        }
    }
    EXPECT_GT(moved, 0);
}
TEST(DimLenslets, of_a_dark_row_are_no_reason_to_refuse_their_neighbours) {
    for (const double pitch : {9.7, 10.6, 12.3}) {
        for (const int row : {-2, -1, 0, 1, 2}) {
            SCOPED_TRACE(::testing::Message() << pitch << " px, row " << row);
            White white{.width_px = static_cast<int>(26 * pitch),
                        .height_px = static_cast<int>(26 * pitch),
                        .hexagonal = true,
                        .pitch_px = pitch,
                        .disc_radius_px = 0.45 * pitch,
                        .edge_px = 0.9};
            const double middle = 0.5 * (white.height_px - 1) - 0.4 + row * pitch * std::sqrt(3.0) / 2;
            white.own_light = [&](double, double y) { return std::abs(y - middle) < pitch / 3 ? 0.0 : 1.0; };
            const auto drawn = test::draw(white);
            const auto calibration = calibrate_grid(drawn.frame.view());
            ASSERT_TRUE(calibration) << calibration.error().message();
            EXPECT_LT(test::compare(drawn, *calibration, pitch).rms_px, 0.01);
        }
    }
}

}  // namespace
}  // namespace hord::calib
