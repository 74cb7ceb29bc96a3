// Effects of the camera and of motion on the light, against closed forms.
#include <cmath>
#include <cstring>
#include <vector>

#include <gtest/gtest.h>

#include "hal_sim/optics/camera/slope_blur.h"
#include "tests/hal_sim/optics/camera/small_scene.h"

namespace hord::sim {
namespace {

constexpr double kSampling = 0.02;  // error of sampling the cells that an edge crosses, bins of light

// Share of a point's light between a and b, in units of the first zero, by summation.
double share_between(double a, double b) {
    constexpr int kSteps = 4000;
    double sum = 0;
    for (int k = 0; k < kSteps; ++k) {
        const double x = kPi * (a + (b - a) * (k + 0.5) / kSteps);
        sum += (x == 0 ? 1 : std::pow(std::sin(x) / x, 2)) * (b - a) / kSteps;
    }
    return sum;
}

TEST(Diffraction, is_the_pattern_of_a_square_aperture) {
    EXPECT_NEAR(share_between(-1, 1), 0.9028233336, 1e-6);  // of the main lobe
    for (const double first_zero : {0.02, 0.18, 1.0, 2.5}) {
        const SlopeGrid line{-4.5, -0.5, 1, 9, 1};
        const SlopeBlur diffraction = SlopeBlur::diffraction(first_zero, 1.0, 9);
        std::vector<double> sharp(27 * 3), blurred(9);
        sharp[27 + 13] = 1;  // the middle third of the middle bin
        diffraction.blur(line, sharp.data(), blurred.data());
        const auto even = [&](double low, double high) {  // the fine cell's light between two edges
            double sum = 0;
            for (int k = 0; k < 60; ++k) {
                const double from = ((k + 0.5) / 60 - 0.5) / 3;
                sum += share_between((low - from) / first_zero, (high - from) / first_zero) / 60;
            }
            return sum;
        };
        for (int i = 2; i < 7; ++i)
            EXPECT_NEAR(blurred[static_cast<std::size_t>(i)], even(i - 4.5, i - 3.5) * even(-0.5, 0.5), 2e-5)
                << first_zero << " bin " << i;
    }
}

TEST(Diffraction, blurs_a_point_into_the_pattern_and_keeps_its_light) {
    const SlopeGrid grid{-4.5, -4.5, 1, 9, 9};
    const SlopeBlur diffraction = SlopeBlur::diffraction(1.0, 1.0, 9);
    const SlopeGrid fine = diffraction.fine(grid);
    ASSERT_EQ(fine.i, 27);
    std::vector<double> sharp(27 * 27), blurred(81);
    sharp[13 * 27 + 13] = 1;  // the middle third of the middle bin
    diffraction.blur(grid, sharp.data(), blurred.data());
    double all = 0;
    for (int j = 0; j < 9; ++j) {
        for (int i = 0; i < 9; ++i) {
            const auto at = [&](int k, int l) { return blurred[static_cast<std::size_t>(l * 9 + k)]; };
            all += at(i, j);
            EXPECT_NEAR(at(i, j), at(8 - i, j), 1e-12);
            EXPECT_NEAR(at(i, j), at(j, i), 1e-12);
            EXPECT_NEAR(at(i, j) * at(4, 4), at(i, 4) * at(4, j), 1e-12);  // a product
        }
    }
    const double kept = 1 - 1 / (kPi * kPi * 4.5);  // its wings fall as 1 / (2 pi^2 x) beyond x on either side
    EXPECT_NEAR(all, kept * kept, 1e-3);
}

TEST(Diffraction, grows_with_the_wavelength_and_moves_nothing) {
    Scene scene = wedge(1.3);
    scene.camera.field_mm = 1.8;  // lenslets of 0.2 mm
    const auto spread = [&](double wavelength) {
        scene.light.wavelength_nm = wavelength;
        const std::vector<double> bins = bins_of(scene, 4, 4);
        double sum = 0, u = 0, uu = 0;
        for (int k = 0; k < 81; ++k)
            sum += bins[static_cast<std::size_t>(k)], u += bins[static_cast<std::size_t>(k)] * (k % 9);
        for (int k = 0; k < 81; ++k) uu += bins[static_cast<std::size_t>(k)] * std::pow(k % 9 - u / sum, 2);
        return std::pair(u / sum, uu / sum);
    };
    const auto sharp = spread(500);
    scene.effects.diffraction = true;
    const auto green = spread(500), infrared = spread(1500);
    EXPECT_GT(green.second, sharp.second + 0.01);
    EXPECT_GT(infrared.second, green.second + 0.01);
    EXPECT_NEAR(green.first, sharp.first, 0.05);  // light that leaves the bins on the nearer side is lost
}

TEST(Stop, lets_the_light_of_its_disc_of_slopes_through) {
    Scene scene = small(NoPart{}, 9);
    const double all = hord(scene, 4, 4).sum;
    scene.camera.relay.stop_radius_mm = 0.4 * 0.015 * 100;  // two fifths of a bin
    EXPECT_NEAR(hord(scene, 4, 4).sum, kPi * 0.16, kSampling);
    scene.camera.relay.stop_radius_mm = 0.9 * 0.015 * 100;
    EXPECT_NEAR(hord(scene, 4, 4).sum, all, 1e-9);
    Scene bent = wedge(2);
    EXPECT_GT(hord(bent, 4, 4).sum, 1);
    bent.camera.relay.stop_radius_mm = 1 * 0.015 * 100;
    EXPECT_EQ(hord(bent, 4, 4).sum, 0);
}

TEST(Vignetting, takes_the_light_that_passes_outside_a_lens) {
    Scene scene = small(NoPart{}, 9);
    scene.camera.relay.lens1_radius_mm = 8;  // three pitches: through the middle of lenslet (7, 4)
    EXPECT_NEAR(hord(scene, 4, 4).sum, kSource, 1e-6);
    EXPECT_EQ(hord(scene, 8, 4).sum, 0);
    // A straight edge through the middle would halve the light. The rim is closer by y^2 / 16 mm at distance y across.
    // The mean of y^2 is 1.333^2 / 3 over the lenslet plus 0.915^2 / 4 over the light's disc of 0.915 mm on the lens.
    // The light is less by the resulting mean shift over 2.667 mm.
    EXPECT_NEAR(hord(scene, 7, 4).sum / kSource, 0.5 - (1.333 * 1.333 / 3 + 0.915 * 0.915 / 4) / 16 / 2.667, kSampling);
    scene.camera.relay.lens1_radius_mm = 0;
    scene.camera.relay.lens2_radius_mm = 8;
    EXPECT_EQ(hord(scene, 0, 4).sum, 0);
    scene.camera.relay.f2_mm = 50;  // half the size at the second lens
    EXPECT_NEAR(hord(scene, 0, 4).sum, kSource, 1e-6);
}

TEST(Crosstalk, puts_light_beyond_a_lenslet_s_range_into_its_neighbour) {
    Scene scene = wedge(6);
    scene.camera.field_mm = 12;  // the whole field is behind the wedge
    const LightField lost = *render(scene);
    EXPECT_LT(hord(lost, 4, 4).sum, 1e-6);
    scene.effects.crosstalk = true;
    const LightField found = *render(scene);
    const Hord h = hord(found, 4, 4);
    EXPECT_GT(h.sum, 1);
    std::vector<double> cells(27 * 27);
    const SlopeGrid wide = SlopeGrid::of(scene.camera.extents, 1);
    LensletLight(scene, wide).collect(CameraGeometry(scene).place_of(3, 4), wide, wide.box(), cells.data());
    double u = 0, sum = 0;
    for (int k = 0; k < 27 * 27; ++k)
        sum += cells[static_cast<std::size_t>(k)], u += cells[static_cast<std::size_t>(k)] * (k % 27 - 13);
    EXPECT_GT(u / sum, 5);
    EXPECT_NEAR(h.u, u / sum - 9, 1e-6);  // seen nine bins to the left, one lenslet to the right
    EXPECT_NEAR(h.sum, sum, 1e-6);
    EXPECT_LT(hord(found, 0, 4).sum, 1e-6);
    const LightField again = *render(scene, {3, {}});
    EXPECT_EQ(std::memcmp(found.bins.data(), again.bins.data(), found.bins.size() * sizeof(float)), 0);
}

TEST(Dust, shades_where_it_lies_and_stays_when_the_part_moves) {
    Scene scene = small(NoPart{}, 9);
    const double pitch = 24.0 / 9;
    scene.camera.dust = {{Dust::Plane::lenslets, pitch, 0, 0.5, 0.25}};
    const double shadow = 0.75 * kPi * 0.25 / (pitch * pitch);
    EXPECT_NEAR(hord(scene, 5, 4).sum / kSource, 1 - shadow, kSampling);
    EXPECT_NEAR(hord(scene, 4, 4).sum, kSource, 1e-6);
    // Dust in the stop blocks the same slopes for every lenslet.
    scene.camera.dust = {{Dust::Plane::stop, 0, 0, 0.3 * 0.015 * 100, 0}};
    for (const int m : {0, 4, 8}) EXPECT_NEAR(hord(scene, m, 4).sum, kSource - kPi * 0.09, kSampling);
    scene.part = Plate{};
    scene.camera.dust = {{Dust::Plane::lenslets, pitch, 0, 0.5, 0.25}};
    const double before = hord(scene, 5, 4).sum;
    scene.pose = {1.3, 0.4, 0};
    EXPECT_NEAR(hord(scene, 5, 4).sum, before, 1e-4);
}

TEST(Haze, spreads_slopes_by_its_rms_and_keeps_the_light) {
    Scene scene = small(Plate{}, 9);
    const double pitch = 24.0 / 9, bin = scene.camera.bin_pitch_rad;
    const std::vector<double> clean = bins_of(scene, 4, 4), beside = bins_of(scene, 6, 4);
    const Haze haze{{0, 0, 0}, 1.2 * pitch, bin};
    scene.defects = {haze};
    const auto moments = [](const std::vector<double>& bins) {  // light, and its mean square along u
        double sum = 0, square = 0;
        for (int k = 0; k < 81; ++k) {
            const double light = bins[static_cast<std::size_t>(k)];
            sum += light, square += light * (k % 9 - 4) * (k % 9 - 4);
        }
        return std::pair{sum, square / sum};
    };
    const auto [light, square] = moments(bins_of(scene, 4, 4));
    EXPECT_NEAR(light, kSource, 2e-3 * kSource);
    // Disc, Gaussian, the fine cell that is even before it is spread, and the bin; less what lies beyond the bins.
    EXPECT_NEAR(square, 0.61 * 0.61 / 4 + 1 + 1.0 / 108 + 1.0 / 12, 0.01);
    const std::vector<double> away = bins_of(scene, 6, 4);
    for (std::size_t k = 0; k < away.size(); ++k) EXPECT_NEAR(away[k], beside[k], 1e-6) << k;
    // A quarter of the lenslet is covered: three quarters of its light go straight on.
    scene.defects = {Haze{{0, 0, 0}, pitch / std::sqrt(4 * kPi), bin}};
    const auto [some, less] = moments(bins_of(scene, 4, 4));
    EXPECT_NEAR(some, kSource, 2e-2 * kSource);
    const double straight = moments(clean).second;
    EXPECT_NEAR(less, straight + 0.25 * (square - straight), 0.01);
}

TEST(Motion, smears_an_edge_over_the_way_and_leaves_the_inside_alone) {
    Scene scene = small(Plate{}, 9);
    scene.glass.absorption_per_mm = 0.5;  // transmits exp(-2)
    const double pitch = 24.0 / 9, dark = std::exp(-2.0);
    std::get<Plate>(scene.part).half_size_mm = 3.5 * pitch;  // its edge is that of lenslet 7
    constexpr double kWall =
        0.01;  // light with slopes up to 0.009 meets the side wall 2 mm from the plane: 0.018 mm of 2.67
    EXPECT_NEAR(hord(scene, 7, 4).sum / kSource, dark, kWall);
    EXPECT_NEAR(hord(scene, 8, 4).sum / kSource, 1, kWall);
    scene.motion = {1000, 0, pitch * 1000};  // travel of one lenslet: mm/s * us * 1e-6
    ASSERT_NEAR(scene.motion.way_x_mm(), pitch, 1e-12);
    // During the exposure the edge moves within half a pitch of its position: 1/8 of the light each way.
    EXPECT_NEAR(hord(scene, 7, 4).sum / kSource, dark + (1 - dark) / 8, kWall);
    EXPECT_NEAR(hord(scene, 8, 4).sum / kSource, 1 - (1 - dark) / 8, kWall);
    EXPECT_NEAR(hord(scene, 4, 4).sum / kSource, dark, 1e-3);
    EXPECT_NEAR(hord(scene, 4, 8).sum / kSource, 1, kWall);
}

}  // namespace
}  // namespace hord::sim
