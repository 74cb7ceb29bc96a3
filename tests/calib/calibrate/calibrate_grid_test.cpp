// Calibration from white frames of known truth.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/calib/support/synthetic.h"

namespace hord::calib {
namespace {

using test::White;
using ::testing::AllOf, ::testing::Contains, ::testing::ElementsAre, ::testing::HasSubstr, ::testing::Not;

// Required accuracy of the fitted grid at 20 ke- a pixel.
constexpr double kGridRms = 0.001;
constexpr double kGridMax = 0.005;

void expect_grid(const White& white, double rms_px, double max_px) {
    const auto drawn = test::draw(white);
    const auto calibration = calibrate_grid(drawn.frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_EQ(calibration->fit.grid.kind, white.hexagonal ? algo::LatticeKind::hexagonal : algo::LatticeKind::square);
    const auto compared = test::compare(drawn, *calibration, white.pitch_px);
    EXPECT_EQ(compared.unmatched_truth, 0);
    EXPECT_EQ(compared.invented, 0);
    EXPECT_GE(compared.found_alive, static_cast<int>(0.99 * compared.alive_complete));
    EXPECT_LT(compared.rms_px, rms_px) << calibration->fit.reason;
    EXPECT_LT(compared.max_px, max_px) << calibration->fit.reason;
}

TEST(CalibrateGrid, square_lattice_with_dead_lenslets_is_found_to_a_thousandth_of_a_pixel) {
    expect_grid({.width_px = 700, .height_px = 600, .pitch_px = 17.3, .rotation_deg = 3, .dead_share = 0.02}, kGridRms,
                kGridMax);
}

TEST(CalibrateGrid, shear_perspective_and_distortion_are_fitted) {
    expect_grid({.width_px = 900,
                 .height_px = 800,
                 .pitch_px = 15.7,
                 .rotation_deg = -7,
                 .shear = 0.002,
                 .perspective_x = 0.002,
                 .perspective_y = -0.002,
                 .k1 = -0.004,
                 .dead_share = 0.02},
                kGridRms, kGridMax);
}

TEST(CalibrateGrid, hexagonal_lattice_is_found_at_any_rotation) {
    for (const double rotation : {0.0, 10.0, 30.0, -22.0}) {
        SCOPED_TRACE(rotation);
        expect_grid({.width_px = 600,
                     .height_px = 600,
                     .hexagonal = true,
                     .pitch_px = 19.1,
                     .rotation_deg = rotation,
                     .dead_share = 0.02},
                    kGridRms, kGridMax);
    }
}

TEST(CalibrateGrid, forty_five_degrees_is_a_rotation_like_any_other) {
    expect_grid({.width_px = 600, .height_px = 600, .pitch_px = 18.2, .rotation_deg = 45}, kGridRms, kGridMax);
}

TEST(CalibrateGrid, integer_pitch_at_no_rotation_has_no_bias_of_the_pixel_phase) {
    // All lenslets have the same position relative to the pixels, so that no error averages out.
    expect_grid({.width_px = 500, .height_px = 500, .pitch_px = 20}, 0.002, kGridMax);
    expect_grid({.width_px = 500,
                 .height_px = 500,
                 .hexagonal = true,
                 .pitch_px = 24,
                 .offset_x_px = 0.15,
                 .offset_y_px = 0.37},
                0.002, kGridMax);
}

TEST(CalibrateGrid, pitches_from_eight_to_sixty_four_pixels_are_found) {
    expect_grid({.width_px = 300, .height_px = 300, .pitch_px = 8.4, .rotation_deg = 1}, 0.003, 0.01);
    expect_grid({.width_px = 1000, .height_px = 1000, .pitch_px = 63, .rotation_deg = -2}, 0.002, kGridMax);
}

TEST(CalibrateGrid, spots_are_lenslets_too) {
    expect_grid({.width_px = 500, .height_px = 500, .pitch_px = 23, .rotation_deg = 0.6, .disc_radius_px = -1.6},
                kGridRms, kGridMax);
}

TEST(CalibrateGrid, vignetting_inside_the_lenslets_does_not_shift_the_grid) {
    // A centre of gravity would be g R / 8 wrong: 0.2 px at the corner.
    expect_grid(
        {.width_px = 800, .height_px = 800, .pitch_px = 20.3, .rotation_deg = 2, .vignetting = 0.2, .dead_share = 0.02},
        0.02, 0.05);
}

TEST(CalibrateGrid, sharp_edges_do_not_shift_centres_with_their_place_on_the_pixels) {
    for (const double radius : {4.24, 3.03}) {  // discs nearly touching, and apart
        SCOPED_TRACE(radius);
        expect_grid({.width_px = 420,
                     .height_px = 420,
                     .pitch_px = 10.1,
                     .rotation_deg = 2.9,
                     .disc_radius_px = radius,
                     .edge_px = 0.3,
                     .subpixels = 6},
                    kGridRms, kGridMax);
    }
}

// -- single lenslets

// An array whose lenslets each have a small shift, which no smooth model describes.
TEST(CalibrateGrid, misplaced_lenslets_get_places_of_their_own) {
    for (const bool hexagonal : {false, true}) {
        SCOPED_TRACE(hexagonal);
        const White white{.width_px = 600,
                          .height_px = 600,
                          .hexagonal = hexagonal,
                          .pitch_px = 17.3,
                          .rotation_deg = 3,
                          .k1 = 0.004,
                          .misplaced_px = 0.05,
                          .dead_share = 0.02};
        const auto drawn = test::draw(white);
        const auto calibration = calibrate_grid(drawn.frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        const GridFit& fit = calibration->fit;
        ASSERT_FALSE(fit.grid.shifts_px.empty()) << fit.candidates.back().verdict;
        EXPECT_TRUE(fit.candidates.back().single_lenslets);
        EXPECT_TRUE(fit.candidates.back().chosen);
        EXPECT_EQ(
            std::count_if(fit.candidates.begin(), fit.candidates.end(), [](const ModelReport& r) { return r.chosen; }),
            1);
        EXPECT_THAT(fit.reason, HasSubstr("every lenslet's own shift"));
        EXPECT_NEAR(fit.shifts.rms_px, white.misplaced_px, 0.1 * white.misplaced_px);
        EXPECT_GT(fit.shifts.share, 0.98);
        EXPECT_LT(fit.shifts.left_x_px, 0.2 * fit.cv_x_rms_px);
        // RMS distance from the true positions: below 0.005 px with the measured shifts, above 0.06 px without.
        algo::LensletGrid smooth = fit.grid;
        smooth.shifts_px.clear();
        double with = 0, without = 0;
        int measured = 0;
        for (const Observation& seen : calibration->observations) {
            if (!seen.used) continue;
            const auto at = fit.grid.centre_px(seen.m, seen.n), model = smooth.centre_px(seen.m, seen.n);
            const auto true_one = std::min_element(drawn.truth.begin(), drawn.truth.end(),
                                                   [&](const test::TruePoint& a, const test::TruePoint& b) {
                                                       return std::hypot(a.x - model.x_px, a.y - model.y_px) <
                                                           std::hypot(b.x - model.x_px, b.y - model.y_px);
                                                   });
            with += std::pow(std::hypot(at.x_px - true_one->x, at.y_px - true_one->y), 2);
            without += std::pow(std::hypot(model.x_px - true_one->x, model.y_px - true_one->y), 2);
            ++measured;
        }
        RecordProperty(
            hexagonal ? "hexagonal, px from the truth with and without" : "square, px from the truth with and without",
            test::text(std::sqrt(with / measured)) + " and " + test::text(std::sqrt(without / measured)));
        EXPECT_LT(std::sqrt(with / measured), 0.005);
        EXPECT_GT(std::sqrt(without / measured), 0.06);
    }
}

// A few displaced lenslets: the model is fitted to the others, and the few are decoded at their own positions.
TEST(CalibrateGrid, a_few_displaced_lenslets_get_places_of_their_own) {
    White white{.width_px = 600, .height_px = 600, .pitch_px = 18.7, .rotation_deg = 2};
    // At most one lenslet in each 75 px cell, so that no two are neighbours.
    const auto is_displaced = [](double x, double y) { return std::fmod(x, 75) < 18.7 && std::fmod(y, 75) < 18.7; };
    white.deflect = [&](double x, double y) { return is_displaced(x, y) ? std::pair{0.3, -0.2} : std::pair{0.0, 0.0}; };
    const auto drawn = test::draw(white);
    const auto calibration = calibrate_grid(drawn.frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_GT(calibration->displaced, 10);
    EXPECT_EQ(calibration->rejected, 0);
    EXPECT_EQ(calibration->whole_placed, calibration->whole);
    algo::LensletGrid smooth = calibration->fit.grid;
    smooth.shifts_px.clear();
    int displaced = 0;
    for (const Observation& seen : calibration->observations) {
        const auto at = calibration->fit.grid.centre_px(seen.m, seen.n), model = smooth.centre_px(seen.m, seen.n);
        EXPECT_EQ(seen.displaced, is_displaced(model.x_px, model.y_px)) << seen.m << "," << seen.n;
        if (seen.displaced) ++displaced;
        EXPECT_NEAR(at.x_px - model.x_px, seen.displaced ? 0.3 : 0, 0.02);
        EXPECT_NEAR(at.y_px - model.y_px, seen.displaced ? -0.2 : 0, 0.02);
    }
    EXPECT_EQ(displaced, calibration->displaced);
}

// A shift of one half of a lenslet's light is dirt; large shifts, those at the edge of the light, and those that are
// noise where they are, are not used.
TEST(CalibrateGrid, centres_that_are_not_to_be_believed_get_no_place) {
    GridFit fit;
    fit.grid.kind = algo::LatticeKind::square;
    fit.grid.columns = 12;
    fit.grid.rows = 3;
    fit.grid.span = 1;
    fit.grid.model = algo::GridModelKind::affine;
    fit.grid.parameters = {10, 10, 20, 0, 0, 20};
    fit.rejected = 7;
    const auto off_by = [](int m, int n, double dx, double split) {
        return Observation{.m = m,
                           .n = n,
                           .centre_px = {10 + 20.0 * m + dx, 10 + 20.0 * n},
                           .used = false,
                           .split_px = algo::PixelPoint{split, 0}};
    };
    std::vector<Observation> seen{off_by(0, 0, 0.4, 0.1), off_by(2, 0, 0.4, 0.3), off_by(0, 2, 1.4, 0.1),
                                  off_by(2, 2, 0.4, 0.1), off_by(4, 2, 0.4, 0.1), off_by(5, 2, 0.4, 0.1),
                                  off_by(10, 1, 0.4, 0.1)};
    std::vector<std::uint8_t> whole(36, 1);
    whole[2 * 12 + 2] = 0;
    for (int m = 0; m < 12; ++m) {
        for (int n = 0; n < 3; ++n) {
            Observation fits = off_by(m, n, m < 8 ? 0.01 : 0.15, 0);
            fits.used = std::ranges::none_of(seen, [=](const Observation& of) { return of.m == m && of.n == n; });
            if (fits.used) seen.push_back(fits);
        }
    }
    place_displaced(seen, whole, fit);
    EXPECT_TRUE(seen[0].displaced);
    EXPECT_FALSE(seen[1].displaced) << "its halves disagree";
    EXPECT_FALSE(seen[2].displaced) << "7 % of a pitch";
    EXPECT_FALSE(seen[3].displaced) << "not whole";
    EXPECT_FALSE(seen[4].displaced || seen[5].displaced) << "side by side";
    EXPECT_TRUE(seen[4].unplaced && seen[5].unplaced && seen[2].unplaced) << "to be told of";
    EXPECT_FALSE(seen[0].unplaced || seen[1].unplaced || seen[3].unplaced || seen[6].unplaced);
    EXPECT_FALSE(seen[6].displaced) << "its neighbours are off by nearly as much";
    EXPECT_EQ(fit.displaced, 1);
    EXPECT_EQ(fit.rejected, 6);
    EXPECT_NEAR(fit.grid.centre_px(0, 0).x_px, 10.4, 1e-9);
    EXPECT_NEAR(fit.grid.centre_px(2, 0).x_px, 50, 1e-9);
}

TEST(CalibrateGrid, lenslets_in_their_places_get_none) {
    const White white{
        .width_px = 600, .height_px = 600, .pitch_px = 17.3, .rotation_deg = 3, .k1 = 0.004, .dead_share = 0.02};
    White few = white, sharp = white, gradient = white, whole = white, slightly = white;
    few.electrons_per_dn = 0.02;  // 400 electrons a pixel: residuals of a fiftieth of a pixel, all of it noise
    sharp.edge_px = 0.3;
    sharp.subpixels = 4;
    gradient.vignetting = 0.2;
    whole.pitch_px = 18;
    whole.rotation_deg = 0;
    whole.k1 = 0;
    slightly.misplaced_px = 0.004;  // a true shift, smaller than the rounding of positions in the decoder
    for (const White& one : {white, few, sharp, gradient, whole, slightly}) {
        const auto calibration = calibrate_grid(test::draw(one).frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        EXPECT_TRUE(calibration->fit.grid.shifts_px.empty()) << calibration->fit.reason;
        EXPECT_THAT(calibration->fit.candidates.back().verdict, HasSubstr("not needed"));
    }
}

TEST(CalibrateGrid, three_by_three_lenslets_are_enough) {
    expect_grid({.width_px = 90, .height_px = 90, .pitch_px = 28, .rotation_deg = 1}, 0.01, 0.03);
}

TEST(CalibrateGrid, a_dark_quarter_is_missing_and_not_invented) {
    White white{.width_px = 700, .height_px = 700, .pitch_px = 18.7, .rotation_deg = 2};
    white.light = [](double x, double y) { return x > 350 && y > 350 ? 0.0 : 1.0; };
    const auto drawn = test::draw(white);
    const auto calibration = calibrate_grid(drawn.frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    const auto compared = test::compare(drawn, *calibration, white.pitch_px);
    EXPECT_LT(compared.rms_px, 0.003);
    for (const Observation& seen : calibration->observations) {
        EXPECT_FALSE(seen.centre_px.x_px > 360 && seen.centre_px.y_px > 360) << seen.m << "," << seen.n;
    }
    EXPECT_NEAR(calibration->missing, 0.25 * calibration->complete, calibration->complete / 30.0);
    // No fully lit lenslet is missing: neither the dark quarter nor its edge is expected.
    EXPECT_NEAR(calibration->whole, 0.75 * calibration->complete, calibration->complete / 20.0);
    EXPECT_EQ(calibration->whole_found, calibration->whole);
}

TEST(CalibrateGrid, dead_lenslets_among_lit_ones_are_missing) {
    const auto drawn =
        test::draw({.width_px = 700, .height_px = 700, .pitch_px = 18.7, .rotation_deg = 2, .dead_share = 0.03});
    const auto calibration = calibrate_grid(drawn.frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_EQ(calibration->whole, calibration->complete);
    EXPECT_EQ(calibration->whole - calibration->whole_found, calibration->missing);
    EXPECT_GT(calibration->missing, 20);
}

TEST(CalibrateGrid, thirty_percent_dead_lenslets_leave_the_grid_as_good) {
    expect_grid({.width_px = 700, .height_px = 700, .pitch_px = 18.7, .rotation_deg = -4, .dead_share = 0.3}, kGridRms,
                kGridMax);
}

TEST(CalibrateGrid, a_saturated_frame_is_measured_by_its_edges_and_counted) {
    White white{.width_px = 600,
                .height_px = 600,
                .pitch_px = 20.6,
                .rotation_deg = 1,
                .peak_dn = 300,
                .background_dn = 8,
                .electrons_per_dn = 80,
                .bits = 8};
    const auto drawn = test::draw(white);
    const auto calibration = calibrate_grid(drawn.frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_EQ(calibration->saturated, calibration->found);
    EXPECT_LT(test::compare(drawn, *calibration, white.pitch_px).rms_px, 0.003);
    EXPECT_THAT(calibration->warnings, ElementsAre(AllOf(HasSubstr("lenslets are saturated"), HasSubstr("lower"))));
}

// Rounding makes the tops of dim lenslets flat.
TEST(CalibrateGrid, a_dim_frame_of_few_steps_is_not_saturated) {
    for (const double background : {0.0, 100.0}) {
        const White white{.width_px = 600,
                          .height_px = 600,
                          .pitch_px = 20.6,
                          .rotation_deg = 1,
                          .peak_dn = 20,
                          .background_dn = background,
                          .noise = false,
                          .bits = 8};
        const auto calibration = calibrate_grid(test::draw(white).frame.view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        EXPECT_EQ(calibration->saturated, 0);
        EXPECT_THAT(calibration->warnings, Not(Contains(HasSubstr("are saturated"))));
    }
}

// Samples of 12 bits in the upper bits of 16: they end below full scale.
TEST(CalibrateGrid, a_plateau_below_full_scale_is_saturated) {
    const White white{.width_px = 600,
                      .height_px = 600,
                      .pitch_px = 20.6,
                      .rotation_deg = 1,
                      .peak_dn = 5000,
                      .background_dn = 100,
                      .bits = 12};
    const auto drawn = test::draw(white);
    Frame shifted(white.width_px, white.height_px, 16);
    for (int y = 0; y < white.height_px; ++y) {
        for (int x = 0; x < white.width_px; ++x) shifted.set(x, y, 16 * drawn.frame.view().sample(x, y));
    }
    const auto calibration = calibrate_grid(shifted.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_EQ(calibration->saturated, calibration->found);
}

TEST(CalibrateGrid, single_saturated_lenslets_are_counted_without_a_warning) {
    White white{.width_px = 400, .height_px = 400, .pitch_px = 20.6, .rotation_deg = 1};
    white.light = [](double x, double y) { return std::hypot(x - 200, y - 200) < 25 ? 4.0 : 1.0; };
    const auto calibration = calibrate_grid(test::draw(white).frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_GT(calibration->saturated, 0);
    EXPECT_THAT(calibration->warnings, Not(Contains(HasSubstr("are saturated"))));
}

// They were counted as saturated lenslets, and a person was told to lower the light, which is no cure.
TEST(CalibrateGrid, hot_pixels_are_no_saturated_lenslets) {
    const White white{.width_px = 420, .height_px = 380, .pitch_px = 20.3, .rotation_deg = 2};
    Frame frame = test::draw(white).frame;
    test::Random random(1);
    for (int k = 0; k < 60; ++k) {
        const auto x = static_cast<int>(420 * random.uniform()), y = static_cast<int>(380 * random.uniform());
        frame.set(x, y, 65535);
    }
    const auto calibration = calibrate_grid(frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_LT(calibration->saturated, calibration->found / 50);
    EXPECT_THAT(calibration->warnings, Not(Contains(HasSubstr("are saturated"))));
}

TEST(CalibrateGrid, a_bubble_in_the_white_frame_costs_its_own_lenslets_only) {
    White white{.width_px = 700, .height_px = 700, .pitch_px = 18.7, .rotation_deg = 2};
    white.light = [](double x, double y) {
        const double r = std::hypot(x - 300, y - 420);
        return r < 60 ? 0.02 + 0.6 * std::pow(r / 60, 6) : 1.0;
    };
    const auto drawn = test::draw(white);
    const auto calibration = calibrate_grid(drawn.frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    EXPECT_LT(test::compare(drawn, *calibration, white.pitch_px).rms_px, 0.002);
}

TEST(CalibrateGrid, a_frame_with_a_part_in_the_light_is_no_white_frame) {
    // Structure of half a pitch at full contrast, similar to a textured part inside the lenslets. At the contrast of
    // dust on the array it does no harm.
    White white{.width_px = 500, .height_px = 500, .pitch_px = 18.7, .rotation_deg = 2};
    const auto calibrate = [&](double contrast) {
        white.light = [contrast](double x, double y) {
            return 1 -
                contrast *
                (0.5 + 0.25 * std::sin(0.41 * x + 2 * std::sin(0.051 * y)) +
                 0.25 * std::cos(0.37 * y - 3 * std::cos(0.043 * x)));
        };
        return calibrate_grid(test::draw(white).frame.view());
    };
    const auto through_a_part = calibrate(1);
    ASSERT_FALSE(through_a_part);
    EXPECT_EQ(through_a_part.error().code, ErrorCode::refused);
    EXPECT_THAT(through_a_part.error().message(), HasSubstr("no white frame"));
    EXPECT_TRUE(calibrate(0.05));
}

// A clear lens scales the pattern behind it, evenly: its lenslets fit a grid of their own, half a pitch off the rest.
TEST(CalibrateGrid, a_frame_with_a_lens_in_the_light_is_no_white_frame) {
    White white{.width_px = 500, .height_px = 500, .pitch_px = 18.7};
    white.deflect = [](double x, double y) {
        const double dx = x - 249.5, dy = y - 249.5, scale = std::hypot(dx, dy) < 190 ? -0.05 : 0;
        return std::pair(scale * dx, scale * dy);
    };
    const auto through_a_lens = calibrate_grid(test::draw(white).frame.view());
    ASSERT_FALSE(through_a_lens);
    EXPECT_EQ(through_a_lens.error().code, ErrorCode::refused);
    EXPECT_THAT(through_a_lens.error().message(), HasSubstr("% of its light fits the grid"));
}

TEST(CalibrateGrid, a_hint_that_is_ten_percent_wrong_does_no_harm) {
    const auto drawn = test::draw({.width_px = 400, .height_px = 400, .pitch_px = 18.7, .rotation_deg = 2});
    const auto without = calibrate_grid(drawn.frame.view());
    for (const double wrong : {0.9, 1.1}) {
        GridOptions options;
        options.hint.pitch_px = wrong * 18.7;
        const auto with = calibrate_grid(drawn.frame.view(), {}, options);
        ASSERT_TRUE(with) << with.error().message();
        EXPECT_NEAR(with->pitch_px, without->pitch_px, 1e-4);
    }
}

TEST(CalibrateGrid, one_row_of_lenslets_is_refused_with_the_reason) {
    White white{.width_px = 600, .height_px = 60, .pitch_px = 30};
    white.light = [](double, double y) { return std::abs(y - 29) < 15 ? 1.0 : 0.0; };
    const auto calibration = calibrate_grid(test::draw(white).frame.view());
    ASSERT_FALSE(calibration);
    EXPECT_EQ(calibration.error().code, ErrorCode::refused);
}

TEST(CalibrateGrid, frames_without_lenslets_are_refused_with_the_reason) {
    const auto dark = calibrate_grid(test::draw({.peak_dn = 0}).frame.view());
    ASSERT_FALSE(dark);
    EXPECT_EQ(dark.error().code, ErrorCode::refused);
    EXPECT_THAT(dark.error().message(), HasSubstr("no lattice"));
    const auto full = calibrate_grid(test::draw({.background_dn = 1e6}).frame.view());
    ASSERT_FALSE(full);
    EXPECT_EQ(full.error().code, ErrorCode::refused);
}

TEST(CalibrateGrid, a_dark_frame_of_another_size_is_named) {
    const auto drawn = test::draw({});
    const Frame dark(100, 100, 16);
    const auto calibration = calibrate_grid(drawn.frame.view(), dark.view());
    ASSERT_FALSE(calibration);
    EXPECT_THAT(calibration.error().message(), HasSubstr("100x100"));
}

TEST(CalibrateGrid, a_dark_or_flat_frame_of_other_bits_is_named) {
    const auto drawn = test::draw({.peak_dn = 200, .background_dn = 5, .bits = 8});
    const Frame other(400, 400, 16);
    GridOptions with_flat;
    with_flat.flat = other.view();
    for (const auto& calibration :
         {calibrate_grid(drawn.frame.view(), other.view()), calibrate_grid(drawn.frame.view(), {}, with_flat)}) {
        ASSERT_FALSE(calibration);
        EXPECT_THAT(calibration.error().message(), HasSubstr("frame of 16 bits for a white frame of 8 bits"));
    }
}

TEST(CalibrateGrid, progress_runs_from_nothing_to_all) {
    GridOptions options;
    std::vector<double> seen;
    options.progress = [&](double done) { seen.push_back(done); };
    ASSERT_TRUE(calibrate_grid(test::draw({}).frame.view(), {}, options));
    EXPECT_EQ(seen.front(), 0);
    EXPECT_EQ(seen.back(), 1);
    EXPECT_TRUE(std::is_sorted(seen.begin(), seen.end()));
}

}  // namespace
}  // namespace hord::calib
