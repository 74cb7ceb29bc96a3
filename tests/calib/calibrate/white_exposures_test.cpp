// White frames that show their lenslets twice, light on one side of them, and what a stop cuts under distortion: a grid
// is where the truth is, or a person is told.
#include <cmath>
#include <numbers>
#include <tuple>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "calib/lattice/row_shift.h"
#include "tests/calib/support/synthetic.h"

namespace hord::calib {
namespace {

using test::White;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

// `white` and the same lenslets moved by (dx, dy), with other noise, put together pixel by pixel.
template <class Mix>
Frame mixed(const White& white, double dx, double dy, Mix mix) {
    White moved = white;
    moved.offset_x_px += dx, moved.offset_y_px += dy, moved.seed += 1;
    const Frame a = test::draw(white).frame, b = test::draw(moved).frame;
    Frame out(a.width_px(), a.height_px(), a.bits());
    for (int y = 0; y < out.height_px(); ++y) {
        for (int x = 0; x < out.width_px(); ++x) out.set(x, y, mix(y, a.view().sample(x, y), b.view().sample(x, y)));
    }
    return out;
}
Frame interlaced(const White& white, double dx) {
    return mixed(white, dx, 0, [](int y, std::uint32_t a, std::uint32_t b) { return y % 2 == 0 ? a : b; });
}

std::vector<std::string> warnings(const Frame& frame) {
    const auto calibration = calibrate_grid(frame.view());
    EXPECT_TRUE(calibration) << calibration.error().message();
    return calibration ? calibration->warnings : std::vector<std::string>{};
}

// Whatever the lenslets look like and wherever they lie on the pixels, also at whole pitches of an even number of rows.
TEST(RowShift, of_interlaced_fields_is_measured_and_of_whole_frames_there_is_none) {
    for (const double pitch : {16.0, 17.3}) {
        for (const double spot : {0.0, -1.6}) {
            for (const bool hexagonal : {false, true}) {
                SCOPED_TRACE(::testing::Message() << pitch << " px, spot " << spot << ", hexagonal " << hexagonal);
                const White white{.width_px = 300,
                                  .height_px = 280,
                                  .hexagonal = hexagonal,
                                  .pitch_px = pitch,
                                  .rotation_deg = pitch == 16 ? 0.0 : 2.0,
                                  .disc_radius_px = spot};
                for (const double shift : {0.0, 0.1, -0.3}) {
                    const Frame frame = interlaced(white, shift);
                    const auto image = WhiteImage::open(frame.view(), {});
                    ASSERT_TRUE(image);
                    const RowShift seen = row_shift(*image);
                    EXPECT_NEAR(seen.px, -shift, 0.005 + 0.05 * std::abs(shift));
                    EXPECT_LT(seen.sigma, 0.01);
                }
            }
        }
    }
}

TEST(RowShift, needs_light_and_rows) {
    const Frame low(40, 24, 16);
    const auto dark = WhiteImage::open(low.view(), {});
    ASSERT_TRUE(dark);
    EXPECT_EQ(row_shift(*dark).px, 0);
}

TEST(WhiteExposures, interlaced_rows_are_warned_of) {
    const White white{.width_px = 400, .height_px = 380, .pitch_px = 16.3, .rotation_deg = 2};
    for (const double shift : {0.06, -0.5, 3.0}) {
        SCOPED_TRACE(shift);
        EXPECT_THAT(warnings(interlaced(white, shift)), Contains(HasSubstr("every second row of pixels is shifted")));
    }
    EXPECT_THAT(warnings(interlaced(white, 0.02)), IsEmpty());  // centres are off by half of it
}

// Of spots, as far as real ones are not longer in one direction themselves: 1.6 sigma apart or more.
TEST(WhiteExposures, spots_that_are_exposed_twice_are_warned_of) {
    const White white{.width_px = 400, .height_px = 380, .pitch_px = 16.3, .rotation_deg = 2, .disc_radius_px = -1.6};
    const auto twice = [&](double dx, double dy) {
        return warnings(mixed(white, dx, dy, [](int, std::uint32_t a, std::uint32_t b) { return (a + b) / 2; }));
    };
    EXPECT_THAT(twice(2.8, 0), Contains(HasSubstr("exposed twice")));
    EXPECT_THAT(twice(2, -2), Contains(HasSubstr("exposed twice")));
    EXPECT_THAT(twice(0.5, 0), IsEmpty());
}

// Of lenslets that light fills, by their edges: blurred along the way from one exposure to the other, and not across
// it.
TEST(WhiteExposures, lenslets_that_are_exposed_twice_are_warned_of) {
    for (const bool hexagonal : {false, true}) {
        for (const double pitch : {9.4, 16.3}) {
            SCOPED_TRACE(::testing::Message() << hexagonal << " " << pitch);
            const White white{.width_px = 400,
                              .height_px = 380,
                              .hexagonal = hexagonal,
                              .pitch_px = pitch,
                              .rotation_deg = 2,
                              .edge_px = 0.4};
            const auto twice = [&](double dx, double dy) {
                return warnings(
                    mixed(white, dx, dy, [](int, std::uint32_t a, std::uint32_t b) { return (a + b) / 2; }));
            };
            for (const auto& [dx, dy] : {std::pair(1.0, 0.0), {-0.7, 0.8}, {0.0, 2.0}})
                EXPECT_THAT(twice(dx, dy), Contains(HasSubstr("two exposures that lie"))) << dx << " " << dy;
            EXPECT_THAT(twice(0.3, 0), IsEmpty());
        }
    }
}

// Discs a third of a pitch apart fill the gap to their neighbours, so that neither length nor edges show them.
TEST(WhiteExposures, lenslets_that_fill_the_gap_by_two_exposures_are_warned_of) {
    for (const auto& [pitch, radius, dx, dy] : {std::tuple(17.3, 0.42, 0.32, 0.0),
                                                {17.3, 0.42, 0.35, 0.0},
                                                {10.0, 0.35, 0.29, 0.14},
                                                {10.0, 0.35, 0.23, 0.23},
                                                {10.0, 0.46, 0.14, 0.14}}) {
        SCOPED_TRACE(::testing::Message() << pitch << " " << dx << " " << dy);
        const White white{
            .width_px = 400, .height_px = 380, .pitch_px = pitch, .rotation_deg = 2, .disc_radius_px = radius * pitch};
        const Frame twice =
            mixed(white, dx * pitch, dy * pitch, [](int, std::uint32_t a, std::uint32_t b) { return (a + b) / 2; });
        EXPECT_THAT(warnings(twice), Contains(HasSubstr("exposure")));
        EXPECT_THAT(warnings(test::draw(white).frame), IsEmpty());
    }
}

// The weaker one blurs edges little, and turns the light of a square lattice by 90 degrees little.
TEST(WhiteExposures, a_weaker_second_exposure_is_warned_of) {
    for (const auto& [pitch, edge, dx, dy, share] : {std::tuple(23.3, 0.7, 4.93, 0.2, 0.2),
                                                     {13.9, 0.5, 3.2, 1.8, 0.2},
                                                     {21.7, 0.5, 2.0, 3.5, 0.2},
                                                     {15.7, 1.1, 5.49, 0.1, 0.1}}) {
        SCOPED_TRACE(::testing::Message() << pitch << " " << dx << " " << dy << " " << share);
        const White white{.width_px = 360,
                          .height_px = 330,
                          .pitch_px = pitch,
                          .rotation_deg = 2,
                          .disc_radius_px = 0.4 * pitch,
                          .edge_px = edge};
        const double weak = share;
        const Frame twice = mixed(white, dx, dy, [=](int, std::uint32_t a, std::uint32_t b) {
            return static_cast<std::uint32_t>(std::lround((1 - weak) * a + weak * b));
        });
        EXPECT_THAT(warnings(twice), Contains(HasSubstr("exposure")));
        EXPECT_THAT(warnings(test::draw(white).frame), IsEmpty());
    }
}

// With a tenth of the light it looks like light on one side, whose shift is not measured: both causes are named.
TEST(WhiteExposures, one_that_looks_like_light_on_one_side_is_named_beside_it) {
    for (const auto& [pitch, edge, dx, dy] : {std::tuple(12.57, 1.06, 3.1, 2.0), {12.95, 0.8, 3.16, 0.22}}) {
        SCOPED_TRACE(pitch);
        const White white{.width_px = 360,
                          .height_px = 330,
                          .hexagonal = pitch > 12.9,
                          .pitch_px = pitch,
                          .disc_radius_px = 0.36 * pitch,
                          .edge_px = edge,
                          .subpixels = 3};
        const Frame twice = mixed(white, dx, dy, [](int, std::uint32_t a, std::uint32_t b) {
            return static_cast<std::uint32_t>(std::lround(0.9 * a + 0.1 * b));
        });
        EXPECT_THAT(warnings(twice),
                    Contains(AllOf(HasSubstr("brighter on the same side"), HasSubstr("which is left"),
                                   HasSubstr("a second, weaker exposure"))));
    }
}

// Those of a hexagonal lattice are longer in one direction, or the fit of hexagonal_exposures() tells of them.
TEST(WhiteExposures, hexagonal_discs_a_third_of_a_pitch_apart_are_warned_of) {
    for (const auto& [pitch, radius, apart, way_deg] : {std::tuple(17.3, 0.35, 0.32, 0.0),
                                                        {17.3, 0.42, 0.335, 30.0},
                                                        {17.3, 0.46, 0.35, 90.0},
                                                        {10.0, 0.35, 0.32, 90.0},
                                                        {10.0, 0.42, 0.32, 0.0}}) {
        SCOPED_TRACE(::testing::Message() << pitch << " px, radius " << radius << ", " << apart << " apart");
        const White white{.width_px = 400,
                          .height_px = 380,
                          .hexagonal = true,
                          .pitch_px = pitch,
                          .rotation_deg = 2,
                          .disc_radius_px = radius * pitch};
        const double way = (way_deg + white.rotation_deg) * std::numbers::pi / 180;
        const Frame twice = mixed(white, apart * pitch * std::cos(way), apart * pitch * std::sin(way),
                                  [](int, std::uint32_t a, std::uint32_t b) { return (a + b) / 2; });
        EXPECT_THAT(warnings(twice), Contains(HasSubstr("exposure")));
        EXPECT_THAT(warnings(test::draw(white).frame), IsEmpty());
    }
}

// A turn by 60 degrees changes squares, whatever their light.
TEST(WhiteExposures, squares_on_a_hexagonal_lattice_are_not_exposed_twice) {
    for (const auto& [radius, edge] : {std::pair(0.3, 0.8), {0.36, 0.8}, {0.4, 1.0}, {0.4, 2.5}}) {
        SCOPED_TRACE(::testing::Message() << radius << ", edge " << edge);
        const White white{.width_px = 300,
                          .height_px = 276,
                          .hexagonal = true,
                          .pitch_px = 12,
                          .disc_radius_px = radius * 12,
                          .edge_px = edge,
                          .square = true,
                          .subpixels = 3};
        EXPECT_THAT(warnings(test::draw(white).frame), Not(Contains(HasSubstr("exposure"))));
        const Frame along = mixed(white, 2, 0, [](int, std::uint32_t a, std::uint32_t b) { return (a + b) / 2; });
        if (edge > 2) continue;
        EXPECT_THAT(warnings(along), Contains(HasSubstr("two exposures that lie")));
    }
}

// Their neighbours are nearer across the rows than along them, and the light there looks like a blurred edge.
TEST(WhiteExposures, lenslets_on_a_hexagonal_lattice_that_lie_apart_across_the_rows_are_warned_of) {
    struct Case {
        double pitch, rotation, radius, edge, apart;
        bool square;
    };
    for (const Case& of :
         {Case{18, 0, 0.4, 1.6, 3.4, false}, Case{20.5, 7, 0.38, 1.6, 4.5, false}, Case{12, 0, 0.36, 1.0, 2.0, true},
          Case{14.3, 2, 0.4, 2.0, 2.2, true}, Case{20.0, 15, 0.35, 1.0, 5.0, true}}) {
        SCOPED_TRACE(::testing::Message() << of.pitch << " px, apart " << of.apart);
        const White white{.width_px = static_cast<int>(24 * of.pitch),
                          .height_px = static_cast<int>(22 * of.pitch),
                          .hexagonal = true,
                          .pitch_px = of.pitch,
                          .rotation_deg = of.rotation,
                          .disc_radius_px = of.radius * of.pitch,
                          .edge_px = of.edge,
                          .square = of.square,
                          .subpixels = 3};
        EXPECT_THAT(warnings(test::draw(white).frame), IsEmpty());
        const double across = (90 + of.rotation) * std::numbers::pi / 180;
        const Frame twice = mixed(white, of.apart * std::cos(across), of.apart * std::sin(across),
                                  [](int, std::uint32_t a, std::uint32_t b) { return (a + b) / 2; });
        EXPECT_THAT(warnings(twice), Contains(HasSubstr("two exposures that lie")));
    }
}

// Lenslets that are exposed twice, a third to half a pitch apart, look like other lattices, or like no lenslets.
TEST(WhiteExposures, refusals_of_frames_that_may_be_exposed_twice_say_so) {
    struct Case {
        const char* refused;
        bool hexagonal, square;
        double pitch, rotation, width, edge, dx, dy;
    };
    for (const Case& of : {Case{"neither square nor hexagonal", false, true, 22.78, 7, 0.796, 0.4, 0.3, 8.47},
                           Case{"neither square nor hexagonal", true, false, 18.96, 0, 0.797, 0.69, -8.36, 0.74},
                           Case{"as bright as in them", false, false, 21.8, 2, 0.732, 0.44, -5.45, 6.72},
                           Case{"a lenslet pitch of about 7", false, true, 14.06, 0, 0.669, 0.75, -0.64, 5.56},
                           Case{"lenslets can be measured", true, false, 18.27, 0, 0.744, 0.7, 1.43, 8.44},
                           Case{"look like one another", true, true, 11.61, 0.7, 0.775, 0.62, 4.34, 2.02},
                           Case{"scatter about the best grid", false, false, 17.76, 0, 0.914, 0.43, 6.88, 2.63}}) {
        SCOPED_TRACE(::testing::Message() << of.refused << ", pitch " << of.pitch);
        const White white{.width_px = static_cast<int>(26 * of.pitch),
                          .height_px = static_cast<int>(26 * of.pitch),
                          .hexagonal = of.hexagonal,
                          .pitch_px = of.pitch,
                          .rotation_deg = of.rotation,
                          .disc_radius_px = of.width / 2 * of.pitch,
                          .edge_px = of.edge,
                          .square = of.square,
                          .subpixels = 3};
        const auto twice = calibrate_grid(
            mixed(white, of.dx, of.dy, [](int, std::uint32_t a, std::uint32_t b) { return (a + b) / 2; }).view());
        const std::string told = twice ? "not refused" : twice.error().message();
        EXPECT_THAT(told, AllOf(HasSubstr(of.refused), HasSubstr("one exposure")));
    }
}

// Two dark rows of lenslets repeat themselves at their distance, which looks like a lattice of long steps.
TEST(WhiteExposures, refusals_of_frames_with_two_dark_rows_say_so) {
    for (const bool hexagonal : {false, true}) {
        SCOPED_TRACE(hexagonal);
        White white{.width_px = 370, .height_px = 340, .hexagonal = hexagonal, .pitch_px = 12.4};
        const double step = hexagonal ? 12.4 * std::sqrt(0.75) : 12.4;
        const int apart = hexagonal ? 3 : 2;
        white.own_light = [&](double, double y) {
            const double rows = (y - 0.5 * (white.height_px - 1) - white.offset_y_px) / step;
            return std::abs(std::lround(rows)) == apart ? 0.0 : 1.0;
        };
        const auto dark = calibrate_grid(test::draw(white).frame.view());
        ASSERT_FALSE(dark);
        EXPECT_THAT(dark.error().message(), HasSubstr("rows of dark lenslets"));
    }
}

// Each edge of a square that moves along the lattice's diagonal is blurred alike. Its corners are not.
TEST(WhiteExposures, squares_that_are_exposed_twice_along_the_diagonal_are_warned_of) {
    for (const bool hexagonal : {false, true}) {
        for (const auto& [pitch, rotation, edge] :
             {std::tuple(10.0, 0.0, 1.0), {14.3, 2.0, 2.0}, {20.0, 15.0, 1.0}, {20.0, 40.0, 3.0}}) {
            SCOPED_TRACE(::testing::Message() << hexagonal << " " << pitch << " px, edge " << edge);
            const White white{.width_px = static_cast<int>(24 * pitch),
                              .height_px = static_cast<int>(22 * pitch),
                              .hexagonal = hexagonal,
                              .pitch_px = pitch,
                              .rotation_deg = rotation,
                              .disc_radius_px = (hexagonal ? 0.38 : 0.42) * pitch,
                              .edge_px = edge,
                              .square = true,
                              .subpixels = 3};
            EXPECT_THAT(warnings(test::draw(white).frame), Not(Contains(HasSubstr("exposure"))));
            const double angle = (45 + rotation) * std::numbers::pi / 180, apart = 0.2 * pitch;
            for (const auto& [dx, dy] :
                 {std::pair(std::cos(angle), std::sin(angle)), {-std::sin(angle), std::cos(angle)}}) {
                const Frame twice = mixed(white, apart * dx, apart * dy,
                                          [](int, std::uint32_t a, std::uint32_t b) { return (a + b) / 2; });
                EXPECT_THAT(warnings(twice), Contains(HasSubstr("two exposures that lie")));
            }
        }
    }
}

// A shear or a turn of the lenslets moves their corners as well, and is no blur.
TEST(WhiteExposures, sheared_or_distorted_squares_are_not_exposed_twice) {
    for (const auto& [shear, k1, to_scale] : {std::tuple(0.02, 0.0, false), {0.0, -0.03, true}, {0.01, 0.03, false}}) {
        SCOPED_TRACE(::testing::Message() << shear << " " << k1 << " " << to_scale);
        const White white{.width_px = 420,
                          .height_px = 400,
                          .pitch_px = 14.3,
                          .rotation_deg = 2,
                          .shear = shear,
                          .k1 = k1,
                          .to_scale = to_scale,
                          .disc_radius_px = 0.4 * 14.3,
                          .edge_px = 1,
                          .square = true,
                          .subpixels = 3};
        const auto calibration = calibrate_grid(test::draw(white).frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        const EdgeBlur& blur = calibration->diagonal_blur;
        EXPECT_GT(blur.own_px2, 0);
        EXPECT_LT(blur.more_px2, 0.1 * blur.own_px2);
    }
}

// A lenslet that is wider than high is no double exposure: its edge is as sharp there as elsewhere.
TEST(WhiteExposures, lenslets_that_are_longer_one_way_are_not_exposed_twice) {
    for (const double k1 : {-0.05, 0.0, 0.05}) {
        SCOPED_TRACE(k1);
        const White white{
            .width_px = 500, .height_px = 300, .pitch_px = 16.3, .shear = 0.05, .k1 = k1, .to_scale = true};
        const auto calibration = calibrate_grid(test::draw(white).frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        EXPECT_LT(calibration->edge_blur.more_px2, 0.2 * calibration->edge_blur.own_px2);
    }
}

// Where distortion is strong, the lenslets are of one size or scaled by a relay lens. Cut ones are neither.
TEST(WhiteExposures, lenslets_that_a_stop_cuts_under_distortion_are_warned_of) {
    for (const double pitch : {10.0, 17.3}) {
        for (const auto& [k1, to_scale] :
             {std::pair(-0.04, false), {-0.025, false}, {-0.015, true}, {0.015, true}, {0.05, true}, {0.05, false}}) {
            SCOPED_TRACE(::testing::Message() << pitch << " px, k1 " << k1 << ", scaled " << to_scale);
            White white{.width_px = 500,
                        .height_px = 500,
                        .pitch_px = pitch,
                        .rotation_deg = 2,
                        .k1 = k1,
                        .to_scale = to_scale};
            EXPECT_THAT(warnings(test::draw(white).frame), Not(Contains(HasSubstr("narrower outwards"))));
            white.stop = [](double x, double y) { return std::pair((250 - x) / 250, (250 - y) / 250); };
            EXPECT_THAT(warnings(test::draw(white).frame), Contains(HasSubstr("narrower outwards")));
        }
    }
}

// The profile is learned again until it is that of the lenslets, and not that of their shifted centres.
TEST(WhiteExposures, light_on_one_side_of_lenslets_that_it_fills_moves_the_grid_little) {
    for (const bool hexagonal : {false, true}) {
        for (const double gradient : {0.2, 0.3}) {
            SCOPED_TRACE(::testing::Message() << hexagonal << " " << gradient);
            White white{.width_px = 400, .height_px = 380, .hexagonal = hexagonal, .pitch_px = 17.3, .rotation_deg = 2};
            white.gradient = [=](double, double) { return std::pair(gradient, 0.0); };
            const auto drawn = test::draw(white);
            const auto calibration = calibrate_grid(drawn.frame.view());
            ASSERT_TRUE(calibration) << calibration.error().message();
            EXPECT_LT(test::compare(drawn, *calibration, white.pitch_px).rms_px, 0.025);
            EXPECT_THAT(calibration->warnings, IsEmpty());
        }
    }
}

}  // namespace
}  // namespace hord::calib
