// Lenslets that the stop of the optics cuts, where a lens distorts the frame: whole lenslets look narrower or wider
// there, too, by the light of their neighbours and by what a relay lens scales.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "calib/lattice/round_lenslet.h"
#include "tests/calib/support/synthetic.h"

namespace hord::calib {
namespace {

using test::White;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

std::vector<std::string> warnings(const White& white) {
    const auto calibration = calibrate_grid(test::draw(white).frame.view());
    EXPECT_TRUE(calibration) << calibration.error().message();
    return calibration ? calibration->warnings : std::vector<std::string>{};
}

// Discs of 90 % of the pitch: half of the light half way between them is that of the neighbour.
TEST(RoundLenslet, is_known_from_the_profile_of_lenslets_that_nearly_touch) {
    for (const bool hexagonal : {false, true}) {
        for (const double edge : {0.6, 1.0}) {
            SCOPED_TRACE(::testing::Message() << hexagonal << ", edge " << edge);
            const White white{.width_px = 200,
                              .height_px = 200,
                              .hexagonal = hexagonal,
                              .pitch_px = 12.3,
                              .disc_radius_px = 0.45 * 12.3,
                              .edge_px = edge,
                              .subpixels = 2};
            const auto drawn = test::draw(white);
            const auto image = WhiteImage::open(drawn.frame.view(), {});
            ASSERT_TRUE(image);
            std::vector<algo::PixelPoint> places;
            for (const auto& point : drawn.truth) places.push_back({point.x, point.y});
            const auto finder = CentreFinder::learn(*image, places, white.pitch_px);
            ASSERT_TRUE(finder);
            const algo::LensletGrid::Steps steps{{white.pitch_px, 0}, {0, white.pitch_px}};
            std::vector<Spot> spots;
            for (const algo::PixelPoint& place : places) {
                if (const auto spot = finder->measure(place, 1)) spots.push_back(*spot);
            }
            const auto lenslet = round_lenslet(
                *image, spots, *finder, neighbours_of(steps, hexagonal ? algo::Stagger::rows : algo::Stagger::none));
            ASSERT_TRUE(lenslet);
            EXPECT_NEAR(lenslet->radius_px, white.disc_radius_px, 0.05);
            EXPECT_NEAR(lenslet->edge_px, edge, 0.1);
        }
    }
}

// Pincushion distortion moves the neighbours away outwards.
TEST(CutLenslets, that_nearly_touch_under_distortion_are_whole) {
    for (const double pitch : {9.3, 10.4, 12.0}) {
        for (const double edge : {0.8, 1.0}) {
            for (const bool hexagonal : {false, true}) {
                SCOPED_TRACE(::testing::Message() << pitch << " px, edge " << edge << ", hexagonal " << hexagonal);
                EXPECT_THAT(warnings({.width_px = 400,
                                      .height_px = 400,
                                      .hexagonal = hexagonal,
                                      .pitch_px = pitch,
                                      .k1 = 0.02,
                                      .disc_radius_px = 0.45 * pitch,
                                      .edge_px = edge}),
                            Not(Contains(HasSubstr("narrower outwards"))));
            }
        }
    }
}

// What a relay lens scales is known to 5 %. A cut of 2 px is 0.3 px of the grid here.
TEST(CutLenslets, that_a_relay_lens_scales_are_warned_of_if_a_stop_cuts_them) {
    for (const double k1 : {-0.055, -0.034, 0.03}) {
        SCOPED_TRACE(k1);
        White white{.width_px = 460,
                    .height_px = 460,
                    .pitch_px = 18.3,
                    .k1 = k1,
                    .to_scale = true,
                    .disc_radius_px = 0.41 * 18.3,
                    .edge_px = 0.6};
        const auto whole = calibrate_grid(test::draw(white).frame.view());
        ASSERT_TRUE(whole) << whole.error().message();
        EXPECT_LE(std::abs(whole->cut.scaled.narrower), whole->cut.scaled.spread + 0.002);
        if (k1 < -0.05) continue;  // the law itself is not known well enough there
        white.stop = [](double x, double y) { return std::pair((229.5 - x) / 162, (229.5 - y) / 162); };
        EXPECT_THAT(warnings(white), Contains(HasSubstr("narrower outwards")));
    }
}

// A lens scales what it distorts. Of a frame that was cut out beside the axis, the shape changes from border to border.
TEST(CutLenslets, that_a_lens_scales_off_its_axis_are_whole) {
    for (const bool hexagonal : {false, true}) {
        for (const double k1 : {-0.03, 0.03}) {
            for (const double pitch : {12.0, 17.3}) {
                SCOPED_TRACE(::testing::Message() << hexagonal << ", k1 " << k1 << ", " << pitch << " px");
                const White white{.width_px = 700,
                                  .height_px = 700,
                                  .hexagonal = hexagonal,
                                  .pitch_px = pitch,
                                  .rotation_deg = 2,
                                  .k1 = k1,
                                  .to_scale = true,
                                  .disc_radius_px = 0.39 * pitch,
                                  .edge_px = 0.75,
                                  .subpixels = 2};
                const auto beside_axis = [&] {
                    const auto drawn = test::draw(white);
                    const FrameView whole = drawn.frame.view();
                    Frame part(440, 440, 16);
                    for (int y = 0; y < 440; ++y) {
                        for (int x = 0; x < 440; ++x) part.set(x, y, whole.sample(x, y));
                    }
                    const auto calibration = calibrate_grid(part.view());
                    EXPECT_TRUE(calibration) << calibration.error().message();
                    return calibration ? calibration->warnings : std::vector<std::string>{};
                };
                EXPECT_THAT(beside_axis(), Not(Contains(HasSubstr("shape of the lenslets changes"))));
            }
        }
    }
}

}  // namespace
}  // namespace hord::calib
