// Frames that a grid must not silently be wrong on: strong distortion up to the corners, and what is no white frame.
// Each is measured as it should be, refused, or warned of.
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "tests/calib/support/synthetic.h"

namespace hord::calib {
namespace {

using test::White;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kTurn = 2 * std::numbers::pi;

// A frame of a formula, with photon noise.
template <class Light>
Frame paint(int side, Light light) {
    test::Random random(3);
    Frame frame(side, side, 16);
    for (int y = 0; y < side; ++y) {
        for (int x = 0; x < side; ++x) {
            const double dn = light(x, y);
            frame.set(x, y, static_cast<std::uint32_t>(std::clamp(dn + random.normal() * std::sqrt(dn), 0.0, 65535.0)));
        }
    }
    return frame;
}

Frame blurred(const Frame& frame, double sigma_px) {
    cv::Mat1f light(frame.height_px(), frame.width_px());
    for (int y = 0; y < light.rows; ++y) {
        for (int x = 0; x < light.cols; ++x) light(y, x) = static_cast<float>(frame.view().sample(x, y));
    }
    cv::GaussianBlur(light, light, {0, 0}, sigma_px);
    return paint(light.cols, [&](int x, int y) { return static_cast<double>(light(y, x)); });
}

void expect_refused(const Frame& frame, const char* why) {
    const auto calibration = calibrate_grid(frame.view());
    ASSERT_FALSE(calibration) << calibration->fit.reason;
    EXPECT_EQ(calibration.error().code, ErrorCode::refused);
    EXPECT_THAT(calibration.error().what, HasSubstr(why));
    EXPECT_FALSE(calibration.error().cure.empty());
}

void expect_corners(const White& white) {
    const auto drawn = test::draw(white);
    const auto calibration = calibrate_grid(drawn.frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    const auto compared = test::compare(drawn, *calibration, white.pitch_px);
    EXPECT_EQ(compared.unmatched_truth, 0) << "corner lenslets taken for their neighbours";
    EXPECT_EQ(compared.invented, 0);
    EXPECT_LT(compared.rms_px, 0.002) << calibration->fit.reason;
    EXPECT_LT(compared.max_px, 0.05) << calibration->fit.reason;
    EXPECT_GE(calibration->found, 0.99 * calibration->complete);
    EXPECT_EQ(calibration->apart, 0);
    EXPECT_EQ(calibration->torn, 0);
    EXPECT_THAT(calibration->warnings, IsEmpty());
}

// k1 at half the side: -0.06 moves the corners by 17 %, fifteen pitches. A relay lens scales the lenslets, too.
TEST(NotSilentlyWrong, radial_distortion_is_followed_to_the_corners) {
    for (const double k1 : {-0.06, -0.03, 0.1}) {
        SCOPED_TRACE(k1);
        expect_corners(
            {.width_px = 1000, .height_px = 1000, .pitch_px = 17.3, .rotation_deg = 2, .k1 = k1, .to_scale = true});
    }
}

TEST(NotSilentlyWrong, so_is_barrel_distortion_of_the_division_model) {
    for (const double division : {-0.1, -0.04}) {
        SCOPED_TRACE(division);
        for (const bool hexagonal : {false, true}) {
            expect_corners({.width_px = 900,
                            .height_px = 800,
                            .hexagonal = hexagonal,
                            .pitch_px = 20,
                            .rotation_deg = 2,
                            .division = division,
                            .to_scale = true});
        }
    }
}

TEST(NotSilentlyWrong, so_is_distortion_of_a_lattice_at_forty_five_degrees) {
    expect_corners({.width_px = 1000,
                    .height_px = 1000,
                    .pitch_px = 18.2,
                    .rotation_deg = 45,
                    .division = -0.06,
                    .to_scale = true});
}

// Lenslets of one size that the distortion pushes into one another cannot be measured in the corners.
TEST(NotSilentlyWrong, corners_whose_lenslets_overlap_are_refused_by_their_place) {
    for (const double k1 : {-0.05, -0.06}) {
        SCOPED_TRACE(k1);
        const auto calibration = calibrate_grid(
            test::draw({.width_px = 1000, .height_px = 1000, .pitch_px = 17.3, .rotation_deg = 2, .k1 = k1})
                .frame.view());
        ASSERT_FALSE(calibration);
        EXPECT_THAT(calibration.error().what, ::testing::ContainsRegex("lenslets at the (top|bottom) (left|right)"));
    }
}

// Near the fold of barrel distortion, lenslets of the corners come from columns and rows beyond all measured ones. The
// grid has them, or there is none.
TEST(NotSilentlyWrong, no_lenslet_of_a_corner_is_lost) {
    int grids = 0, refused = 0;
    for (const double k1 : {-0.07, -0.0725, -0.08}) {
        for (const double rotation : {0.0, 8.0}) {
            SCOPED_TRACE(::testing::Message() << k1 << ", " << rotation << " degrees");
            const auto drawn = test::draw({.width_px = 700,
                                           .height_px = 700,
                                           .pitch_px = 14,
                                           .rotation_deg = rotation,
                                           .k1 = k1,
                                           .to_scale = true,
                                           .disc_radius_px = -1.6});
            const auto calibration = calibrate_grid(drawn.frame.view());
            calibration ? ++grids : ++refused;
            if (!calibration) {
                EXPECT_THAT(calibration.error().what, ::testing::ContainsRegex("at the (top|bottom) (left|right)"));
                continue;
            }
            EXPECT_EQ(test::compare(drawn, *calibration, 14).unmatched_truth, 0);
            EXPECT_EQ(calibration->inside, static_cast<int>(drawn.truth.size()));
        }
    }
    EXPECT_GE(grids, 2);
    EXPECT_GE(refused, 2);
}

TEST(NotSilentlyWrong, a_dark_corner_is_counted_and_named) {
    White white{.width_px = 700, .height_px = 700, .pitch_px = 18.7, .rotation_deg = 2};
    white.light = [](double x, double y) { return x < 110 && y > 590 ? 0.0 : 1.0; };
    const auto calibration = calibrate_grid(test::draw(white).frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_GT(calibration->missing, 20);
    EXPECT_LT(calibration->missing, 0.05 * calibration->complete);
    EXPECT_EQ(calibration->missing, calibration->complete - calibration->found);
    EXPECT_THAT(calibration->warnings,
                Contains(::testing::ContainsRegex("[0-9]+ of [0-9]+ lenslets at the bottom left")));
    white.light = nullptr;
    white.dead_share = 0.02;
    EXPECT_THAT(calibrate_grid(test::draw(white).frame.view())->warnings, IsEmpty());
}

// Light that is brighter on one side of each lenslet moves a spot. Where only half of the frame has it, a grid that is
// off by more than 0.022 px is warned of. All over the frame it moves all centres alike, and no frame shows it.
TEST(NotSilentlyWrong, light_that_is_brighter_on_one_side_is_warned_of) {
    int warned = 0;
    for (const double gradient : {0.02, 0.03, 0.04, 0.16}) {
        for (const double spot : {-1.6, -3.0, 0.0}) {
            SCOPED_TRACE(::testing::Message() << gradient << ", spot " << -spot << " px");
            White white{.width_px = 600, .height_px = 600, .pitch_px = 17.3, .rotation_deg = 2, .disc_radius_px = spot};
            white.gradient = [gradient](double x, double) { return std::pair(x < 300 ? gradient : 0.0, 0.0); };
            const auto drawn = test::draw(white);
            const auto calibration = calibrate_grid(drawn.frame.view());
            if (!calibration || !calibration->warnings.empty()) ++warned;
            else EXPECT_LT(test::compare(drawn, *calibration, 17.3).rms_px, 0.022);
        }
    }
    EXPECT_GE(warned, 4);
}

TEST(NotSilentlyWrong, a_checkerboard_is_refused) {
    const auto board = [](int side) {
        return paint(400, [side](int x, int y) { return ((x / side + y / side) & 1) != 0 ? 20000.0 : 200.0; });
    };
    for (const int side : {6, 7, 9, 11, 14, 20}) expect_refused(board(side), "checkerboard");
    // Fields of 4 and 5 px in turn, which repeat after 9 px: bright ones of two sizes.
    expect_refused(paint(400, [](int x, int y) { return (x % 9 < 4) == (y % 9 < 4) ? 20000.0 : 200.0; }),
                   "checkerboard");
}

// Also along the pixels at whole pitches, where all periods lie alike on the pixels.
TEST(NotSilentlyWrong, two_gratings_are_refused) {
    for (const bool crossed : {false, true}) {
        for (const double pitch : {9.0, 10.0, 11.0, 12.0, 13.0, 17.3}) {
            for (const double tilt : {0.0, 0.05}) {
                SCOPED_TRACE(::testing::Message() << crossed << ", pitch " << pitch << ", tilt " << tilt);
                expect_refused(paint(400,
                                     [=](int x, int y) {
                                         const double a = 1 + std::cos(kTurn * (x + tilt * y) / pitch);
                                         const double b = 1 + std::cos(kTurn * (y - tilt * x) / pitch);
                                         return 200 + 5000 * (crossed ? a * b : a + b);
                                     }),
                               "gratings");
            }
        }
    }
}

TEST(NotSilentlyWrong, a_frame_blurred_by_six_pixels_is_refused) {
    const White white{.width_px = 600, .height_px = 600, .pitch_px = 20, .rotation_deg = 2};
    const Frame sharp = test::draw(white).frame;
    expect_refused(blurred(sharp, 6), "out of focus");
    EXPECT_TRUE(calibrate_grid(blurred(sharp, 1).view()));
}

TEST(NotSilentlyWrong, an_object_in_the_light_is_warned_of) {
    White white{.width_px = 600, .height_px = 600, .pitch_px = 16, .rotation_deg = 2, .disc_radius_px = -1.6};
    const auto warnings = [&](double contrast, double period) {
        white.light = [=](double x, double y) {
            return 1 -
                contrast *
                (0.5 + 0.25 * std::sin(kTurn * x / period + std::sin(.02 * y)) +
                 0.25 * std::cos(kTurn * y / period - std::cos(.03 * x)));
        };
        const auto calibration = calibrate_grid(test::draw(white).frame.view());
        EXPECT_TRUE(calibration) << calibration.error().message();
        return calibration ? calibration->warnings : std::vector<std::string>{};
    };
    EXPECT_THAT(warnings(0.3, 64), Contains(HasSubstr("follow the light")));
    EXPECT_THAT(warnings(0.3, 128), Contains(HasSubstr("follow the light")));
    EXPECT_THAT(warnings(0.3, 32), Contains(HasSubstr("from lenslet to lenslet")));
    EXPECT_THAT(warnings(0, 64), IsEmpty());
}

// Spots of aberrated light are not the lenslets' centres. Coma is no distortion of a lens; aberrations that are like
// one cannot be told from it.
TEST(NotSilentlyWrong, aberrated_spots_are_warned_of) {
    White white{.width_px = 600, .height_px = 600, .pitch_px = 24, .disc_radius_px = -2};
    white.deflect = [](double x, double y) {
        const double u = (x - 300) / 300, v = (y - 300) / 300;
        return std::pair(2 * (3 * u * u + v * v), 2 * 2 * u * v);
    };
    const auto calibration = calibrate_grid(test::draw(white).frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_THAT(calibration->warnings, Contains(HasSubstr("aberrated")));
}

// A weak lens in the light moves the centres behind it by up to a pixel, and the single lenslets' shifts follow it.
// Lenslets that are misplaced by as much have shifts that differ from neighbour to neighbour.
TEST(NotSilentlyWrong, light_bent_together_is_told_from_misplaced_lenslets) {
    const auto warnings = [](const White& white) {
        const auto calibration = calibrate_grid(test::draw(white).frame.view());
        EXPECT_TRUE(calibration) << calibration.error().message();
        EXPECT_GT(calibration->fit.shifts.rms_px, 0.05);
        return calibration ? calibration->warnings : std::vector<std::string>{};
    };
    const auto lens = [](double x, double y) {
        const double u = (x - 300) / 200, v = (y - 300) / 200;
        return u * u + v * v < 1 ? std::pair(u, v) : std::pair(0.0, 0.0);
    };
    White white{.width_px = 600, .height_px = 600, .pitch_px = 18.6, .rotation_deg = 2};
    white.deflect = lens;
    EXPECT_THAT(warnings(white), Contains(HasSubstr("together with their neighbours")));
    white.deflect = [](double x, double) { return std::pair(0.1 * std::sin(kTurn * x / 110), 0.0); };
    EXPECT_THAT(warnings(white), Contains(HasSubstr("together with their neighbours")));
    white.deflect = nullptr;
    white.misplaced_px = 0.15;
    EXPECT_THAT(warnings(white), IsEmpty());
}

// Every second or third lenslet lies on a lattice of a larger pitch, which a hint can ask for.
TEST(NotSilentlyWrong, a_lattice_of_some_lenslets_only_is_refused) {
    const auto refusal = [](const Frame& frame, double pitch) {
        GridOptions options;
        options.hint.pitch_px = pitch;
        const auto calibration = calibrate_grid(frame.view(), {}, options);
        return calibration ? std::string("a grid") : calibration.error().what;
    };
    const Frame board = paint(600, [](int x, int y) { return ((x / 5 + y / 5) & 1) != 0 ? 20000.0 : 200.0; });
    EXPECT_THAT(refusal(board, 11), HasSubstr("every second lenslet"));
    const White white{
        .width_px = 300, .height_px = 300, .hexagonal = true, .pitch_px = 6, .rotation_deg = 2, .edge_px = 0.5};
    EXPECT_THAT(refusal(test::draw(white).frame, 11), HasSubstr("every third lenslet"));
}

// Whichever way noise and distortion turn a pitch at the limit; and a sentence that refuses says a smaller one.
TEST(NotSilentlyWrong, lenslets_at_the_smallest_pitch_are_measured) {
    for (const bool hexagonal : {false, true}) {
        for (const double pitch : {7.98, 7.9996, 8.0}) {
            for (const double k1 : {-0.004, 0.0, 0.004}) {
                SCOPED_TRACE(::testing::Message() << hexagonal << ", pitch " << pitch << ", k1 " << k1);
                const auto drawn = test::draw({.width_px = 300,
                                               .height_px = 300,
                                               .hexagonal = hexagonal,
                                               .pitch_px = pitch,
                                               .rotation_deg = 2,
                                               .k1 = k1,
                                               .edge_px = 0.5});
                const auto calibration = calibrate_grid(drawn.frame.view());
                ASSERT_TRUE(calibration) << calibration.error().message();
                EXPECT_LT(test::compare(drawn, *calibration, pitch).max_px, 0.01);
            }
        }
    }
}

TEST(NotSilentlyWrong, lenslets_below_the_smallest_pitch_are_refused_by_their_pitch) {
    for (const bool hexagonal : {false, true}) {
        for (const double spot : {0.0, -1.2}) {
            for (const double pitch : {4.0, 5.0, 6.0, 6.5, 7.0, 7.5, 7.9, 7.94}) {
                SCOPED_TRACE(::testing::Message() << hexagonal << ", spot " << -spot << ", pitch " << pitch);
                expect_refused(test::draw({.width_px = 300,
                                           .height_px = 300,
                                           .hexagonal = hexagonal,
                                           .pitch_px = pitch,
                                           .rotation_deg = 2,
                                           .disc_radius_px = spot,
                                           .edge_px = 0.5})
                                   .frame,
                               "a lenslet pitch of");
            }
        }
    }
    // Bright fields of 5 px are 7.07 px apart along the diagonals.
    expect_refused(paint(600, [](int x, int y) { return ((x / 5 + y / 5) & 1) != 0 ? 20000.0 : 200.0; }),
                   "a lenslet pitch of");
}

// Cat's-eye vignetting, by 1 px at half the side: centres move as another pitch moves them, and lenslets are narrower.
// Distortion that scales the lenslets makes them so, too: no_warning in expect_corners.
TEST(NotSilentlyWrong, lenslets_that_a_stop_cuts_are_warned_of) {
    for (const bool hexagonal : {false, true}) {
        SCOPED_TRACE(hexagonal);
        White white{.width_px = 500, .height_px = 450, .hexagonal = hexagonal, .pitch_px = 16.3, .rotation_deg = 2};
        const auto warnings = [&](double shift_px, double middle_x) {
            white.stop = [=](double x, double y) {
                return std::pair(shift_px * (middle_x - x) / 250, shift_px * (225 - y) / 250);
            };
            const auto calibration = calibrate_grid(test::draw(white).frame.view());
            EXPECT_TRUE(calibration) << calibration.error().message();
            return calibration ? calibration->warnings : std::vector<std::string>{};
        };
        EXPECT_THAT(warnings(1, 250), Contains(HasSubstr("the stop of the optics cuts them")));
        EXPECT_THAT(warnings(1, 150), Contains(HasSubstr("the stop of the optics cuts them")));
        EXPECT_THAT(warnings(0, 250), IsEmpty());
    }
}

// A stop far to one side cuts all lenslets on the same side, the more the farther they are from it: their shape changes
// evenly over the frame.
TEST(NotSilentlyWrong, lenslets_that_are_cut_from_one_side_are_warned_of) {
    for (const double middle_x : {0.0, -250.0, -1000.0}) {
        SCOPED_TRACE(middle_x);
        White white{.width_px = 500, .height_px = 450, .pitch_px = 16.3, .rotation_deg = 2};
        white.stop = [=](double x, double y) { return std::pair(0.6 * (middle_x - x) / 250, 0.6 * (225 - y) / 250); };
        const auto calibration = calibrate_grid(test::draw(white).frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        EXPECT_THAT(calibration->warnings,
                    Contains(::testing::AnyOf(HasSubstr("the stop of the optics cuts them"),
                                              HasSubstr("changes from border to border"))));
    }
}

// All over the frame, on lenslets that light fills: without a word, the centres are off by 0.06 px at the most.
TEST(NotSilentlyWrong, light_that_is_brighter_on_one_side_of_all_lenslets_is_warned_of) {
    for (const double gradient : {0.16, 0.45, 0.7}) {
        SCOPED_TRACE(gradient);
        White white{.width_px = 500, .height_px = 450, .pitch_px = 16.3, .rotation_deg = 2};
        white.gradient = [=](double, double) { return std::pair(0.0, gradient); };
        const auto drawn = test::draw(white);
        const auto calibration = calibrate_grid(drawn.frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        if (gradient > 0.4) {
            EXPECT_THAT(calibration->warnings, Contains(HasSubstr("brighter on the same side")));
        } else {
            EXPECT_THAT(calibration->warnings, IsEmpty());
            EXPECT_LT(test::compare(drawn, *calibration, white.pitch_px).rms_px, 0.02);
        }
    }
}

// Straight sharp edges along the pixels: the frame is smoothed for them. Aligned and turned, centred on pixels and not.
TEST(NotSilentlyWrong, square_lenslets_with_sharp_edges_are_where_the_grid_says) {
    for (const double pitch : {10.0, 15.2, 20.0}) {
        for (const double turn : {0.0, 0.6, 4.0}) {
            SCOPED_TRACE(::testing::Message() << pitch << " px, " << turn << " degrees");
            const White white{.width_px = 320,
                              .height_px = 300,
                              .pitch_px = pitch,
                              .rotation_deg = turn,
                              .offset_x_px = 0.3,
                              .offset_y_px = -0.2,
                              .disc_radius_px = 0.44 * pitch,
                              .edge_px = 1,
                              .square = true,
                              .subpixels = 4};
            const auto drawn = test::draw(white);
            const auto calibration = calibrate_grid(drawn.frame.view());
            ASSERT_TRUE(calibration) << calibration.error().message();
            EXPECT_LT(test::compare(drawn, *calibration, pitch).rms_px, 0.015);
            EXPECT_THAT(calibration->warnings, IsEmpty());
        }
    }
}

// Straight edges along the pixels move centres by where they lie between the pixels: neighbours together.
TEST(NotSilentlyWrong, squares_on_a_hexagonal_lattice_with_sharp_edges_are_not_warned_of) {
    for (const double pitch : {9.08, 10.22, 12.18, 14.07, 20.5}) {
        SCOPED_TRACE(::testing::Message() << pitch << " px");
        const White white{.width_px = static_cast<int>(26 * pitch),
                          .height_px = static_cast<int>(24 * pitch),
                          .hexagonal = true,
                          .pitch_px = pitch,
                          .shear = -0.005,
                          .disc_radius_px = 0.36 * pitch,
                          .edge_px = 1,
                          .square = true,
                          .subpixels = 5,
                          .peak_dn = 3200,
                          .background_dn = 40,
                          .electrons_per_dn = 4,
                          .bits = 12};
        const auto drawn = test::draw(white);
        const auto calibration = calibrate_grid(drawn.frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        EXPECT_THAT(calibration->warnings, IsEmpty());
        EXPECT_LT(test::compare(drawn, *calibration, pitch).rms_px, 0.02);
    }
}

// The gaps between dark dots lie on a lattice, too.
TEST(NotSilentlyWrong, dark_dots_on_a_bright_ground_are_refused) {
    for (const bool hexagonal : {false, true}) {
        for (const double radius : {0.2, 0.3, 0.4, 0.46}) {
            SCOPED_TRACE(::testing::Message() << hexagonal << ", radius " << radius);
            const White white{.width_px = 450,
                              .height_px = 450,
                              .hexagonal = hexagonal,
                              .pitch_px = 16.3,
                              .rotation_deg = 2,
                              .disc_radius_px = radius * 16.3};
            const Frame bright = test::draw(white).frame;
            const auto calibration =
                calibrate_grid(paint(450, [&](int x, int y) { return 22000.0 - bright.view().sample(x, y); }).view());
            ASSERT_FALSE(calibration);
            EXPECT_EQ(calibration.error().code, ErrorCode::refused);
            if (!hexagonal && radius > 0.25) {
                EXPECT_THAT(calibration.error().what, HasSubstr("dark dots"));
            }
        }
    }
}

// Round lenslets that touch one another are no such gaps.
TEST(NotSilentlyWrong, lenslets_that_touch_are_measured) {
    for (const bool hexagonal : {false, true}) {
        const White white{.width_px = 450,
                          .height_px = 450,
                          .hexagonal = hexagonal,
                          .pitch_px = 16.3,
                          .rotation_deg = 2,
                          .disc_radius_px = 0.5 * 16.3};
        const auto drawn = test::draw(white);
        const auto calibration = calibrate_grid(drawn.frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        EXPECT_LT(test::compare(drawn, *calibration, white.pitch_px).rms_px, 0.05);
    }
}

TEST(NotSilentlyWrong, missing_lenslets_are_warned_of) {
    White white{.width_px = 700, .height_px = 700, .pitch_px = 18.7, .rotation_deg = 2};
    white.light = [](double x, double y) { return x > 350 && y > 350 ? 0.0 : 1.0; };
    const auto calibration = calibrate_grid(test::draw(white).frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_THAT(calibration->warnings, Contains(HasSubstr("have no centre")));
}

// Two lit fields with a dark band of six lenslets between them: the numbers across it are the model's.
TEST(NotSilentlyWrong, lenslets_that_no_chain_reaches_are_counted_and_warned_of) {
    White white{.width_px = 700, .height_px = 700, .pitch_px = 18.7, .rotation_deg = 2};
    white.light = [](double x, double) { return x > 400 && x < 520 ? 0.0 : 1.0; };
    const auto drawn = test::draw(white);
    const auto calibration = calibrate_grid(drawn.frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_GT(calibration->apart, 200);
    EXPECT_LT(test::compare(drawn, *calibration, white.pitch_px).rms_px, 0.002);
    EXPECT_THAT(calibration->warnings, Contains(HasSubstr("apart from the others")));
}

}  // namespace
}  // namespace hord::calib
