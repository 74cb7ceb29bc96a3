// Each physical effect against a closed form or a property, and that what is not named is not there.
#include "hal_sim/optics/scene/effects.h"

#include <cmath>
#include <cstring>
#include <fstream>
#include <numeric>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "hal_sim/optics/camera/diffraction.h"
#include "hal_sim/optics/camera/lenslet_light.h"
#include "hal_sim/optics/camera/render.h"

namespace hord::sim {
namespace {

using ::testing::HasSubstr;

constexpr double kPi = 3.14159265358979323846;
constexpr double kSource = kPi * 0.61 * 0.61;  // light of a free lenslet, bins
constexpr double kSampling = 0.02;             // of cells that an edge runs through, bins of light

Scene small(const Part& part, int lenslets = 9) {
    Scene scene;
    scene.part = part;
    scene.camera.extents = {lenslets, lenslets, 9, 9};
    return scene;
}
Scene wedge(double bins) {  // bends the light to the right
    Wedge part;
    part.centre_thickness_mm = 8;
    part.tilt_x_rad = std::atan2(std::tan(bins * 0.015), 0.5) * 0.98;
    return small(part);
}

struct Hord {
    double sum = 0, u = 0, v = 0;
};
Hord hord(const LightField& field, int m, int n) {
    const auto& e = field.extents;
    Hord h;
    for (int j = 0; j < e.j; ++j) {
        for (int i = 0; i < e.i; ++i) {
            const double x = field.bins[static_cast<std::size_t>((n * e.j + j) * e.width_px() + m * e.i + i)];
            h.sum += x, h.u += x * (i - 0.5 * (e.i - 1)), h.v += x * (j - 0.5 * (e.j - 1));
        }
    }
    if (h.sum > 0) h.u /= h.sum, h.v /= h.sum;
    return h;
}
Hord hord(const Scene& scene, int m, int n) {
    std::vector<double> bins(static_cast<std::size_t>(scene.camera.extents.bins()));
    LensletLight(scene).collect(m, n, bins.data());
    LightField one{{1, 1, scene.camera.extents.i, scene.camera.extents.j}, {bins.begin(), bins.end()}};
    return hord(one, 0, 0);
}

// -- glass

TEST(Absorption, follows_beer_and_lambert_along_the_way_in_the_glass) {
    Scene scene = small(Plate{});
    scene.glass.absorption_per_mm = 0.2;
    const Body body = body_of(scene, true);
    EXPECT_NEAR(trace(body, {1, 1, 0, 0}).weight, std::exp(-0.2 * 4), 1e-14);
    const double slope = 0.5, sine = std::sin(std::atan(slope)) / 1.5;
    EXPECT_NEAR(trace(body, {1, 1, slope, 0}).weight, std::exp(-0.2 * 4 / std::sqrt(1 - sine * sine)), 1e-14);
    EXPECT_EQ(trace(body, {9, 9, 0, 0}).weight, 1);
    EXPECT_NEAR(hord(scene, 4, 4).sum, kSource * std::exp(-0.2 * 4), 3e-5);
}

TEST(Absorption, of_a_dark_ball_is_that_of_its_chord_and_an_opaque_one_lets_nothing_through) {
    Scene scene = small(Plate{});
    scene.defects = {Absorber{{0, 0, 0}, 0.5, false, 1.3}};
    const Body body = body_of(scene, true);
    for (const double x : {0.0, 0.2, 0.45})
        EXPECT_NEAR(trace(body, {x, 0, 0, 0}).weight, std::exp(-1.3 * 2 * std::sqrt(0.25 - x * x)), 1e-12) << x;
    EXPECT_EQ(trace(body, {0.2, 0, 0, 0}).u, 0);  // it bends nothing
    EXPECT_EQ(trace(body, {0.6, 0, 0, 0}).weight, 1);
    scene.defects = {Absorber{{0, 0, 0}, 0.5, true}};
    EXPECT_EQ(trace(body_of(scene, true), {0.499, 0, 0, 0}).weight, 0);
    EXPECT_EQ(truth_of(scene).defects.at(0).kind, std::string("absorber"));
}

TEST(Dispersion, has_the_indices_that_define_the_abbe_number) {
    const double d = dispersed(1.5168, 64.17, kLineD), f = dispersed(1.5168, 64.17, 486.13),
                 c = dispersed(1.5168, 64.17, 656.28);
    EXPECT_EQ(d, 1.5168);
    EXPECT_NEAR((d - 1) / (f - c), 64.17, 1e-10);
    EXPECT_NEAR(f, 1.52238, 1.5e-4);  // BK7 of the catalogue; two terms of Cauchy's series are as good as that
    EXPECT_NEAR(c, 1.51432, 1.5e-4);
}

TEST(Dispersion, bends_each_colour_of_the_light_by_its_own_index) {
    Scene scene = wedge(2);
    scene.glass.abbe_number = 30;
    const double tilt = std::get<Wedge>(scene.part).tilt_x_rad;
    for (const double wavelength : {450.0, 650.0}) {
        const double index = dispersed(1.5, 30, wavelength);
        EXPECT_NEAR(shine(body_of(scene, true, wavelength), 0.3, 0).u,
                    std::tan(std::asin(index * std::sin(tilt)) - tilt), 1e-12);
    }
    // Two colours: both images are there, and the mean lies between.
    const auto coloured = [&](std::vector<Collimator> of) {
        scene.light.collimators = std::move(of);
        return hord(scene, 4, 4);
    };
    const Collimator blue{0, 0, 0.00915, 450, 0, 0.5}, red{0, 0, 0.00915, 650, 0, 0.5};
    const Hord b = coloured({blue}), r = coloured({red}), both = coloured({blue, red});
    EXPECT_GT(b.u, r.u + 0.03);
    EXPECT_NEAR(both.sum, b.sum + r.sum, 1e-6);
    EXPECT_NEAR(both.u, (b.u * b.sum + r.u * r.sum) / (b.sum + r.sum), 1e-6);
    // A glass without dispersion has the same image in every colour.
    scene.glass.abbe_number = 0;
    EXPECT_NEAR(coloured({blue}).u, coloured({red}).u, 1e-15);
}

TEST(Fresnel, ghosts_of_a_plate_are_the_light_reflected_twice_within_it) {
    Scene scene = small(Plate{});
    scene.effects.fresnel = true;
    const double once = hord(scene, 4, 4).sum;
    scene.effects.ghosts = true;
    EXPECT_NEAR(hord(scene, 4, 4).sum / once, 1 + 0.04 * 0.04, 1e-6);
    const Body body = body_of(scene, true);
    EXPECT_NEAR(trace(body, {1, 1, 0.02, 0}, nullptr, {1, 2}).weight, 0.96 * 0.96 * 0.04 * 0.04, 1e-7);
    EXPECT_NEAR(trace(body, {1, 1, 0.02, 0}, nullptr, {1, 2}).u, 0.02, 1e-15);
    EXPECT_EQ(trace(body, {1, 1, 0, 0}, nullptr, {1, 3}).weight, 0);  // there is no such way
    EXPECT_EQ(trace(body, {9, 9, 0, 0}, nullptr, {1, 2}).weight, 0);
}

// -- light

TEST(Light, each_collimator_shows_at_its_direction_with_its_power) {
    Scene scene = small(NoPart{});
    scene.light.collimators = {{0.03, -0.015, 0.00915, 550, 0, 1}, {-0.03, 0.03, 0.006, 550, 0, 2}};
    const LightField field = *render(scene);
    const double small_disc = kPi * 0.16;
    const Hord h = hord(field, 4, 4);
    EXPECT_NEAR(h.sum, kSource + 2 * small_disc, 1e-5);
    EXPECT_NEAR(h.u * h.sum, 2 * kSource - 2 * 2 * small_disc, 1e-5);
    EXPECT_NEAR(h.v * h.sum, -kSource + 2 * 2 * small_disc, 1e-5);
}

// -- camera

// Share of a point's light between a and b, in units of the first zero, by adding up.
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
        const Diffraction diffraction(first_zero, 1.0, 9);
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
    const Diffraction diffraction(1.0, 1.0, 9);
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
        std::vector<double> bins(81);
        LensletLight(scene).collect(4, 4, bins.data());
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
    EXPECT_NEAR(green.first, sharp.first, 0.05);  // what leaves the bins on the nearer side is missed
}

TEST(Stop, lets_the_light_of_its_disc_of_slopes_through) {
    Scene scene = small(NoPart{});
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
    Scene scene = small(NoPart{});
    scene.camera.relay.lens1_radius_mm = 8;  // three pitches: through the middle of lenslet (7, 4)
    EXPECT_NEAR(hord(scene, 4, 4).sum, kSource, 1e-6);
    EXPECT_EQ(hord(scene, 8, 4).sum, 0);
    // A straight edge through the middle would halve it. The rim is closer by y^2 / 16 mm at y across: by the mean
    // square over the lenslet, 1.333^2 / 3, and the light's disc of 0.915 mm on the lens, 0.915^2 / 4, so much less
    // of 2.667 mm.
    EXPECT_NEAR(hord(scene, 7, 4).sum / kSource, 0.5 - (1.333 * 1.333 / 3 + 0.915 * 0.915 / 4) / 16 / 2.667, kSampling);
    scene.camera.relay.lens1_radius_mm = 0;
    scene.camera.relay.lens2_radius_mm = 8;
    EXPECT_EQ(hord(scene, 0, 4).sum, 0);
    scene.camera.relay.f2_mm = 50;  // half the size at the second lens
    EXPECT_NEAR(hord(scene, 0, 4).sum, kSource, 1e-6);
}

TEST(Crosstalk, puts_light_beyond_a_lenslet_s_range_into_its_neighbour) {
    Scene scene = wedge(6);
    scene.camera.field_mm = 12;  // all of it behind the wedge
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
    Scene scene = small(NoPart{});
    const double pitch = 24.0 / 9;
    scene.camera.dust = {{Dust::Plane::lenslets, pitch, 0, 0.5, 0.25}};
    const double shadow = 0.75 * kPi * 0.25 / (pitch * pitch);
    EXPECT_NEAR(hord(scene, 5, 4).sum / kSource, 1 - shadow, kSampling);
    EXPECT_NEAR(hord(scene, 4, 4).sum, kSource, 1e-6);
    // In the stop it takes the same slopes from every lenslet.
    scene.camera.dust = {{Dust::Plane::stop, 0, 0, 0.3 * 0.015 * 100, 0}};
    for (const int m : {0, 4, 8}) EXPECT_NEAR(hord(scene, m, 4).sum, kSource - kPi * 0.09, kSampling);
    scene.part = Plate{};
    scene.camera.dust = {{Dust::Plane::lenslets, pitch, 0, 0.5, 0.25}};
    const double before = hord(scene, 5, 4).sum;
    scene.pose = {1.3, 0.4, 0};
    EXPECT_NEAR(hord(scene, 5, 4).sum, before, 1e-4);
}

TEST(Motion, smears_an_edge_over_the_way_and_leaves_the_inside_alone) {
    Scene scene = small(Plate{}, 9);
    scene.glass.absorption_per_mm = 0.5;  // lets exp(-2) through
    const double pitch = 24.0 / 9, dark = std::exp(-2.0);
    std::get<Plate>(scene.part).half_size_mm = 3.5 * pitch;  // its edge is that of lenslet 7
    constexpr double kWall =
        0.01;  // aslant by up to 0.009, light 2 mm from the plane meets the side wall: 0.018 mm of 2.67
    EXPECT_NEAR(hord(scene, 7, 4).sum / kSource, dark, kWall);
    EXPECT_NEAR(hord(scene, 8, 4).sum / kSource, 1, kWall);
    scene.motion = {1000, 0, pitch * 1000};  // one lenslet's way: mm/s * us * 1e-6
    ASSERT_NEAR(scene.motion.way_x_mm(), pitch, 1e-12);
    // The edge is anywhere within half a pitch of where it was: an eighth of the light each way.
    EXPECT_NEAR(hord(scene, 7, 4).sum / kSource, dark + (1 - dark) / 8, kWall);
    EXPECT_NEAR(hord(scene, 8, 4).sum / kSource, 1 - (1 - dark) / 8, kWall);
    EXPECT_NEAR(hord(scene, 4, 4).sum / kSource, dark, 1e-3);
    EXPECT_NEAR(hord(scene, 4, 8).sum / kSource, 1, kWall);
}

// -- sensor (EMVA 1288)

struct Moments {
    double mean = 0, variance = 0;
};
template <class At>
Moments moments(const Frame& frame, const At& at) {
    Moments m;
    const double count = static_cast<double>(frame.width_px()) * frame.height_px();
    for (int pass = 0; pass < 2; ++pass) {
        for (int y = 0; y < frame.height_px(); ++y) {
            for (int x = 0; x < frame.width_px(); ++x) {
                if (pass == 0) m.mean += at(x, y) / count;
                else m.variance += (at(x, y) - m.mean) * (at(x, y) - m.mean) / count;
            }
        }
    }
    return m;
}
Moments moments(const Frame& frame) {
    return moments(frame, [&](int x, int y) { return static_cast<double>(frame.view().sample(x, y)); });
}
constexpr double kSigmas = 5;
constexpr int kPixels = 360 * 360;

Frame even(const Scene& scene, float level, std::uint64_t seed) {
    const std::vector<float> light(kPixels, level);
    return expose(light, 360, 360, scene, seed);
}

TEST(Sensor, dark_current_adds_its_electrons_and_their_shot_noise) {
    Scene scene;
    scene.camera.bits = 16;
    scene.noise = {.electrons_per_dn = 0.5, .dark_dn = 10, .dark_e_per_s = 4000, .exposure_ms = 25};
    const Moments m = moments(even(scene, 0, 3));
    EXPECT_NEAR(m.mean, 10 + 100 / 0.5, kSigmas * std::sqrt(100 / 0.25 / kPixels));
    EXPECT_NEAR(m.variance, 100 / 0.25 + 1.0 / 12, kSigmas * 400 * std::sqrt(2.0 / kPixels));
}

TEST(Sensor, prnu_is_a_pattern_of_the_camera_and_grows_with_the_light) {
    Scene scene;
    scene.camera.bits = 16;
    scene.camera.full_bin_dn = 40000;
    scene.noise.prnu = 0.01;
    for (const double level : {0.25, 1.0}) {
        const Moments m = moments(even(scene, static_cast<float>(level), 1));
        EXPECT_NEAR(std::sqrt(m.variance), 400 * level, 400 * level * kSigmas / std::sqrt(2.0 * kPixels));
    }
    const Frame one = even(scene, 1, 1), other = even(scene, 1, 2);
    EXPECT_EQ(std::memcmp(one.bytes().data(), other.bytes().data(), one.bytes().size()), 0);  // whatever the frame
    scene.noise.pattern_seed = 2;                                                             // another camera
    const Frame third = even(scene, 1, 1);
    const Moments both = moments(one, [&](int x, int y) {
        return static_cast<double>(one.view().sample(x, y)) - static_cast<double>(third.view().sample(x, y));
    });
    EXPECT_NEAR(std::sqrt(both.variance), 400 * std::sqrt(2.0), 10);
}

TEST(Sensor, dsnu_is_a_pattern_that_light_does_not_change) {
    Scene scene;
    scene.camera.bits = 16;
    scene.noise = {.electrons_per_dn = 0.1, .dark_dn = 1000, .dsnu_e = 5, .photon_noise = false};
    const Frame dark = even(scene, 0, 1), lit = even(scene, 0.5F, 2);
    const Moments d = moments(dark), difference = moments(dark, [&](int x, int y) {
                                         return static_cast<double>(lit.view().sample(x, y)) -
                                             static_cast<double>(dark.view().sample(x, y));
                                     });
    EXPECT_NEAR(std::sqrt(d.variance), 50, 50 * kSigmas / std::sqrt(2.0 * kPixels));
    EXPECT_NEAR(difference.mean, 120, 1e-9);
    EXPECT_LT(difference.variance, 1e-9);
}

TEST(Sensor, a_full_well_holds_no_more) {
    Scene scene;
    scene.camera.bits = 12;
    scene.camera.full_bin_dn = 4000;
    scene.noise = {.electrons_per_dn = 4, .full_well_e = 8000};
    EXPECT_NEAR(moments(even(scene, 0.4F, 1)).mean, 1600, 1);
    const Moments m = moments(even(scene, 0.9F, 1));
    EXPECT_NEAR(m.mean, 2000, 1e-6);
    EXPECT_LT(m.variance, 1e-9);
}

TEST(Sensor, without_photon_noise_counts_electrons_exactly) {
    Scene scene;
    scene.noise = {.electrons_per_dn = 4, .photon_noise = false};
    EXPECT_LT(moments(even(scene, 0.5F, 1)).variance, 1e-9);
}

// -- what a scene names

Scene with_every_effect() {
    Scene scene = small(Plate{}, 5);
    scene.camera.field_mm = 12;
    scene.glass = {30, 0.05};
    scene.light.wavelength_nm = 470;
    scene.effects = {true, true, true, true};
    scene.camera.relay = {100, 100, 12, 30, 30};
    scene.camera.dust = {{Dust::Plane::lens1, 0, 0, 0.3, 0.5}};
    scene.motion = {1000, 0, 500};
    scene.noise = {
        .electrons_per_dn = 10, .read_e = 2, .dark_dn = 4, .dark_e_per_s = 10000, .prnu = 0.01, .full_well_e = 10000};
    return scene;
}

TEST(Effects, a_scene_says_which_it_names_and_loses_them_one_by_one) {
    Scene scene = with_every_effect();
    EXPECT_TRUE(problems(scene).empty()) << problems(scene).front().message();
    EXPECT_EQ(effects_of(scene).size(), kEffects);
    EXPECT_TRUE(effects_of(Scene{}).empty());
    for (std::size_t k = 0; k < kEffects; ++k) {
        const auto effect = static_cast<Effect>(k);
        const Scene less = without(scene, effect);
        EXPECT_FALSE(names(less, effect)) << name_of(effect);
        EXPECT_TRUE(problems(less).empty()) << name_of(effect);
        EXPECT_EQ(effects_of(less).size(), kEffects - (effect == Effect::fresnel ? 2 : 1)) << name_of(effect);
    }
}

TEST(Effects, each_changes_the_frame_and_without_all_of_them_it_is_the_plain_one) {
    Scene scene = with_every_effect();
    std::get<Plate>(scene.part).half_size_mm = 3;
    const Frame all = expose(*render(scene), scene, 1);
    Scene bare = scene;
    for (std::size_t k = 0; k < kEffects; ++k) {
        const auto effect = static_cast<Effect>(k);
        bare = without(bare, effect);
        // A stop and lenses that let all light through, and a well that is never full, change nothing here.
        if (effect == Effect::stop || effect == Effect::vignetting || effect == Effect::full_well) continue;
        const Scene less = without(scene, effect);
        const Frame frame = expose(*render(less), less, 1);
        EXPECT_NE(std::memcmp(all.bytes().data(), frame.bytes().data(), frame.bytes().size()), 0) << name_of(effect);
    }
    Scene plain = small(Plate{3, 4, 1.5}, 5);
    plain.camera.field_mm = 12;
    const LightField a = *render(bare), b = *render(plain);
    EXPECT_EQ(std::memcmp(a.bins.data(), b.bins.data(), a.bins.size() * sizeof(float)), 0);
}

std::string refusal(const std::string& text) {
    const auto file = std::filesystem::path(::testing::TempDir()) / "effects_refusal.toml";
    std::ofstream(file) << text;
    const auto scene = load_scene(file);
    return scene ? std::string("accepted") : scene.error().what;
}

TEST(Effects, that_contradict_one_another_are_refused_all_at_once_with_line_and_cure) {
    const std::string all = refusal(R"([part]
kind = "plate"
abbe_number = 60
[effects]
ghosts = true
crosstalk = true
[camera.relay]
stop_radius_mm = 5
[motion]
velocity_mm_s = [500, 0]
[[defect]]
kind = "absorber"
opaque = true
absorption_per_mm = 2
[camera.array]
pitch_um = 100
)");
    EXPECT_THAT(all, HasSubstr(":3: part.abbe_number: changes nothing at the one wavelength"));
    EXPECT_THAT(all, HasSubstr(":5: effects.ghosts: are made of the light that fresnel splits off: name fresnel, too"));
    EXPECT_THAT(all, HasSubstr(":8: camera.relay.stop_radius_mm: lets no light beyond the bins' range"));
    EXPECT_THAT(all, HasSubstr(":9: motion.strobe_us: is 0"));
    EXPECT_THAT(all, HasSubstr(":14: defect[0].absorption_per_mm: contradicts opaque = true"));
    EXPECT_THAT(all, HasSubstr(":16: camera.array.pitch_um: stands alone"));
    EXPECT_THAT(refusal("[light]\nsource_radius_bins = 1\n[[light.collimator]]\npower = 1\n"),
                HasSubstr(":2: light.source_radius_bins: is of the one source"));
    EXPECT_THAT(refusal("[light]\n[[light.collimator]]\npower = 0\n"), HasSubstr("no collimator gives light"));
    EXPECT_THAT(refusal("[camera]\nfield_mm = 20\n[camera.array]\npitch_um = 100\nfocal_um = 300\n"),
                HasSubstr(":2: camera.field_mm: is said by camera.array"));
    EXPECT_THAT(refusal("[part]\nabbe_number = 60\n"), HasSubstr("there is no glass to have a colour"));
    EXPECT_THAT(refusal("[[dust]]\nplane = \"lens3\"\n"), HasSubstr("use one of lens1, stop, lens2, lenslets"));
    EXPECT_THAT(refusal("[motion]\nvelocity_mm_s = [1, 0]\nstrobe_us = 1e7\n"), HasSubstr("lenslets while it is lit"));
}

TEST(Effects, the_array_and_the_relay_say_field_and_bin_pitch) {
    const auto file = std::filesystem::path(::testing::TempDir()) / "effects_array.toml";
    std::ofstream(file) << "[camera]\nm = 100\ni = 9\n[camera.relay]\nf1_mm = 200\nf2_mm = "
                           "100\n[camera.array]\npitch_um = 90\nfocal_um = 500\n";
    const Scene scene = *load_scene(file);
    EXPECT_NEAR(scene.camera.field_mm, 100 * 0.09 * 2, 1e-12);
    EXPECT_NEAR(scene.camera.bin_pitch_rad, 0.01 / 0.5 / 2, 1e-12);
}

}  // namespace
}  // namespace hord::sim
