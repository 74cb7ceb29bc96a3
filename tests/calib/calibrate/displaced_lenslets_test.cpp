// Lenslets that are displaced side by side: they may be misplaced, or something moves their light, and a person is
// told.
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/calib/support/synthetic.h"

namespace hord::calib {
namespace {

using test::White;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// Two lenslets of the middle, one moved along x and the other along y: neither got its place, without a word.
TEST(DisplacedLenslets, side_by_side_are_told_of) {
    for (const double by : {0.0, 0.16, 0.3, 0.5}) {
        for (const bool hexagonal : {false, true}) {
            SCOPED_TRACE(::testing::Message() << by << " px, hexagonal " << hexagonal);
            White white{.width_px = 300,
                        .height_px = 280,
                        .hexagonal = hexagonal,
                        .pitch_px = 14.3,
                        .offset_x_px = 0,
                        .offset_y_px = 0};
            const double x0 = 149.5, y0 = 139.5;
            white.deflect = [=](double x, double y) {
                if (std::hypot(x - x0, y - y0) < 5) return std::pair(by, 0.0);
                return std::hypot(x - x0 - 14.3, y - y0) < 5 ? std::pair(0.0, by) : std::pair(0.0, 0.0);
            };
            const auto calibration = calibrate_grid(test::draw(white).frame.view());
            ASSERT_TRUE(calibration) << calibration.error().message();
            EXPECT_EQ(calibration->displaced, 0);
            if (by == 0) EXPECT_THAT(calibration->warnings, IsEmpty());
            else EXPECT_THAT(calibration->warnings, ElementsAre(HasSubstr("2 lenslets are off the grid by up to")));
        }
    }
}

// No new frame helps there, and the cure says so.
TEST(DisplacedLenslets, of_an_array_that_is_misplaced_too_much_are_named) {
    const White white{.width_px = 400, .height_px = 380, .pitch_px = 14.3, .rotation_deg = 2, .misplaced_px = 0.25};
    const auto calibration = calibrate_grid(test::draw(white).frame.view());
    ASSERT_FALSE(calibration);
    EXPECT_THAT(calibration.error().message(), HasSubstr("the array's own lenslets are misplaced by too much"));
}

// All lenslets lie alike between the pixels, or in two ways: what straight edges leave of a shift was learned from
// where the lenslets are, and explained the misplacement itself. 8 to 73 % of the lenslets were off, without a word.
TEST(DisplacedLenslets, squares_at_a_pitch_of_whole_pixels_keep_their_places) {
    for (const double pitch : {12.0, 14.0, 16.0, 16.5}) {
        SCOPED_TRACE(pitch);
        const White white{.width_px = 340,
                          .height_px = 300,
                          .pitch_px = pitch,
                          .offset_x_px = 3.23,
                          .offset_y_px = 6.39,
                          .disc_radius_px = 0.4 * pitch,
                          .square = true,
                          .subpixels = 3,
                          .misplaced_px = 0.1};
        const auto calibration = calibrate_grid(test::draw(white).frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        EXPECT_TRUE(calibration->fit.candidates.back().chosen) << calibration->fit.candidates.back().verdict;
        EXPECT_NEAR(calibration->fit.shifts.rms_px, white.misplaced_px, 0.15 * white.misplaced_px);
    }
}

}  // namespace
}  // namespace hord::calib
