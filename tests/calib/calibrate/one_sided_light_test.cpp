// White frames whose lenslets are all brighter on the same side: a grid is where the truth is, or a person is told how
// wrong it may be.
#include <cmath>
#include <tuple>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/calib/support/synthetic.h"

namespace hord::calib {
namespace {

using test::White;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// `gradient`: of the light from the middle to the rim; `edge`: sigma, of the radius.
White one_sided(double pitch, double edge, double gradient) {
    White white{.width_px = 300,
                .height_px = 280,
                .pitch_px = pitch,
                .rotation_deg = 2,
                .disc_radius_px = 0.4 * pitch,
                .edge_px = edge * 0.4 * pitch,
                .subpixels = 3};
    white.gradient = [=](double, double) { return std::pair(gradient, 0.0); };
    return white;
}

// All centres were off alike, by 0.13, 0.27 and 0.51 px, without a word.
TEST(OneSidedLight, does_not_move_lenslets_with_soft_edges) {
    for (const double gradient : {0.0, 0.08, 0.16, 0.3}) {
        for (const bool hexagonal : {false, true}) {
            SCOPED_TRACE(::testing::Message() << gradient << " " << hexagonal);
            White white = one_sided(12.2, 0.164, gradient);
            white.hexagonal = hexagonal;
            const auto drawn = test::draw(white);
            const auto calibration = calibrate_grid(drawn.frame.view());
            ASSERT_TRUE(calibration) << calibration.error().message();
            EXPECT_LT(test::compare(drawn, *calibration, white.pitch_px).max_px, 0.02);
            EXPECT_THAT(calibration->warnings, IsEmpty());
        }
    }
}

// Neighbours' light covers the edges, and the fit leaves a part of the shift: the warning says more than that.
TEST(OneSidedLight, on_softer_edges_is_warned_of) {
    for (const auto& [pitch, edge, gradient] : {std::tuple(12.2, 0.25, 0.16), {17.3, 0.23, 0.16}, {20.0, 0.31, 0.2}}) {
        SCOPED_TRACE(::testing::Message() << pitch << " " << edge);
        const White white = one_sided(pitch, edge, gradient);
        const auto drawn = test::draw(white);
        const auto calibration = calibrate_grid(drawn.frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        EXPECT_THAT(calibration->warnings, Contains(HasSubstr("their edges are too soft to measure well")));
        const double off = test::compare(drawn, *calibration, white.pitch_px).max_px;
        EXPECT_LT(off, calibration->odd_light.unsure_px);
        EXPECT_LT(off, calibration->odd_light.shift() / 2);
    }
}

// The shape of the lenslets was told as two exposures, because it was measured beside their middle.
TEST(OneSidedLight, is_not_told_as_two_exposures) {
    const auto drawn = test::draw(one_sided(12.2, 0.164, 0.45));
    const auto calibration = calibrate_grid(drawn.frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_THAT(calibration->warnings, ::testing::ElementsAre(HasSubstr("brighter on the same side")));
    EXPECT_LT(test::compare(drawn, *calibration, 12.2).max_px, 0.02);
}

}  // namespace
}  // namespace hord::calib
