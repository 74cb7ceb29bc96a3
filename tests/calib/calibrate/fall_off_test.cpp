// White frames whose light falls off over the frame: a grid is where the truth is, or a person is told by how much not.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/calib/support/synthetic.h"

namespace hord::calib {
namespace {

using test::White;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// Light that falls off over the frame, on discs whose edges are blurred by a seventh to a third of their radius:
// centres were off by up to 0.6 px towards the light, and by 0.12 px without a word. The softest ones of a hexagonal
// lattice have no plateau: the warning says how far they are off.
TEST(FallOff, does_not_move_lenslets_with_soft_edges) {
    int warned = 0;
    for (const double edge : {0.16, 0.2, 0.25, 0.3, 0.35}) {
        for (const double pitch : {14.2, 20.0}) {
            for (const double fall : {0.05, 0.1, 0.3}) {
                for (const bool hexagonal : {false, true}) {
                    SCOPED_TRACE(::testing::Message()
                                 << edge << " of the radius, pitch " << pitch << ", " << fall << ", " << hexagonal);
                    White white{.width_px = 300,
                                .height_px = 280,
                                .hexagonal = hexagonal,
                                .pitch_px = pitch,
                                .rotation_deg = 1};
                    white.edge_px = edge * 0.42 * pitch;
                    white.light = [fall](double x, double y) {
                        return 1 - fall * (std::pow((x - 150) / 150, 2) + std::pow((y - 140) / 150, 2));
                    };
                    const auto drawn = test::draw(white);
                    const auto calibration = calibrate_grid(drawn.frame.view());
                    ASSERT_TRUE(calibration) << calibration.error().message();
                    const double off = test::compare(drawn, *calibration, pitch).max_px;
                    if (calibration->warnings.empty()) {
                        EXPECT_LT(off, 0.025) << calibration->fit.reason;
                        continue;
                    }
                    ++warned;
                    EXPECT_THAT(calibration->warnings, Contains(HasSubstr("the light falls off over the frame")));
                    EXPECT_NEAR(calibration->by_fall_off_px, off, 0.15 * off);
                }
            }
        }
    }
    EXPECT_LE(warned, 3);
}

// Soft squares on a hexagonal lattice are not smoothed: then fall-off would not be separated from a shift any more.
TEST(FallOff, does_not_move_soft_squares_on_a_hexagonal_lattice) {
    White white{.width_px = 370,
                .height_px = 456,
                .hexagonal = true,
                .pitch_px = 14.85,
                .disc_radius_px = 0.37 * 14.85,
                .edge_px = 1.7,
                .square = true,
                .subpixels = 3};
    white.light = [](double x, double y) {
        return 1 - 0.24 * (std::pow(x - 185, 2) + std::pow(y - 228, 2)) / (185 * 185 + 228 * 228);
    };
    const auto drawn = test::draw(white);
    const auto calibration = calibrate_grid(drawn.frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_THAT(calibration->warnings, IsEmpty());
    EXPECT_LT(test::compare(drawn, *calibration, 14.85).max_px, 0.025);
}

// Lenslets that nearly touch: the weight that is immune to gradients sees their neighbours' light, which differs. It
// gave 44 of 1792 lenslets places of their own, up to 0.39 px off.
TEST(FallOff, gives_lenslets_that_nearly_touch_no_places_of_their_own) {
    for (const double pitch : {8.0, 8.1}) {
        for (const double fall : {0.23, 0.32}) {
            SCOPED_TRACE(::testing::Message() << pitch << ", " << fall);
            White white{.width_px = 300,
                        .height_px = 400,
                        .pitch_px = pitch,
                        .rotation_deg = 1.72,
                        .disc_radius_px = 0.46 * pitch,
                        .edge_px = 0.1 * 0.46 * pitch};
            white.light = [fall](double x, double y) {
                return 1 - fall * (std::pow(x - 150, 2) + std::pow(y - 200, 2)) / 62500;
            };
            const auto drawn = test::draw(white);
            const auto calibration = calibrate_grid(drawn.frame.view());
            ASSERT_TRUE(calibration) << calibration.error().message();
            EXPECT_EQ(calibration->displaced, 0);
            EXPECT_LT(test::compare(drawn, *calibration, pitch).max_px, 0.05);
        }
    }
}

// Spots that are as wide as half their pitch: nothing in them tells light that falls off from a shift.
TEST(FallOff, is_warned_of_where_it_moves_wide_spots) {
    for (const double fall : {0.0, 0.3}) {
        SCOPED_TRACE(fall);
        White white{.width_px = 300, .height_px = 280, .pitch_px = 20, .rotation_deg = 1, .disc_radius_px = -3.5};
        white.light = [=](double x, double y) {
            return 1 - fall * (std::pow((x - 150) / 150, 2) + std::pow((y - 140) / 150, 2));
        };
        const auto calibration = calibrate_grid(test::draw(white).frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        if (fall > 0) EXPECT_THAT(calibration->warnings, Contains(HasSubstr("the light falls off over the frame")));
        else EXPECT_THAT(calibration->warnings, IsEmpty());
    }
}

}  // namespace
}  // namespace hord::calib
