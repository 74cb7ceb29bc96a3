// Glass and light against closed forms.
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "tests/hal_sim/optics/camera/small_scene.h"

namespace hord::sim {
namespace {

TEST(Absorption, follows_beer_and_lambert_along_the_way_in_the_glass) {
    Scene scene = small(Plate{}, 9);
    scene.glass.absorption_per_mm = 0.2;
    const Body body = body_of(scene, true);
    EXPECT_NEAR(trace(body, {1, 1, 0, 0}).weight, std::exp(-0.2 * 4), 1e-14);
    const double slope = 0.5, sine = std::sin(std::atan(slope)) / 1.5;
    EXPECT_NEAR(trace(body, {1, 1, slope, 0}).weight, std::exp(-0.2 * 4 / std::sqrt(1 - sine * sine)), 1e-14);
    EXPECT_EQ(trace(body, {9, 9, 0, 0}).weight, 1);
    EXPECT_NEAR(hord(scene, 4, 4).sum, kSource * std::exp(-0.2 * 4), 3e-5);
}

TEST(Absorption, of_a_dark_ball_is_that_of_its_chord_and_an_opaque_one_lets_nothing_through) {
    Scene scene = small(Plate{}, 9);
    scene.defects = {Absorber{{0, 0, 0}, 0.5, false, 1.3}};
    const Body body = body_of(scene, true);
    for (const double x : {0.0, 0.2, 0.45})
        EXPECT_NEAR(trace(body, {x, 0, 0, 0}).weight, std::exp(-1.3 * 2 * std::sqrt(0.25 - x * x)), 1e-12) << x;
    EXPECT_EQ(trace(body, {0.2, 0, 0, 0}).u, 0);  // no deflection
    EXPECT_EQ(trace(body, {0.6, 0, 0, 0}).weight, 1);
    scene.defects = {Absorber{{0, 0, 0}, 0.5, true}};
    EXPECT_EQ(trace(body_of(scene, true), {0.499, 0, 0, 0}).weight, 0);
}

TEST(Dispersion, has_the_indices_that_define_the_abbe_number) {
    const double d = dispersed(1.5168, 64.17, kLineD), f = dispersed(1.5168, 64.17, 486.13),
                 c = dispersed(1.5168, 64.17, 656.28);
    EXPECT_EQ(d, 1.5168);
    EXPECT_NEAR((d - 1) / (f - c), 64.17, 1e-10);
    EXPECT_NEAR(f, 1.52238, 1.5e-4);  // BK7, catalogue value; tolerance: the error of two terms of Cauchy's series
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
    // Two colours: both images exist, and the mean lies between them.
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
    Scene scene = small(Plate{}, 9);
    scene.effects.fresnel = true;
    const double once = hord(scene, 4, 4).sum;
    scene.effects.ghosts = true;
    EXPECT_NEAR(hord(scene, 4, 4).sum / once, 1 + 0.04 * 0.04, 1e-6);
    const Body body = body_of(scene, true);
    EXPECT_NEAR(trace(body, {1, 1, 0.02, 0}, nullptr, {1, 2}).weight, 0.96 * 0.96 * 0.04 * 0.04, 1e-7);
    EXPECT_NEAR(trace(body, {1, 1, 0.02, 0}, nullptr, {1, 2}).u, 0.02, 1e-15);
    EXPECT_EQ(trace(body, {1, 1, 0, 0}, nullptr, {1, 3}).weight, 0);  // this path does not exist
    EXPECT_EQ(trace(body, {9, 9, 0, 0}, nullptr, {1, 2}).weight, 0);
}

TEST(Light, each_collimator_shows_at_its_direction_with_its_power) {
    Scene scene = small(NoPart{}, 9);
    scene.light.collimators = {{0.03, -0.015, 0.00915, 550, 0, 1}, {-0.03, 0.03, 0.006, 550, 0, 2}};
    const LightField field = *render(scene);
    const double small_disc = kPi * 0.16;
    const Hord h = hord(field, 4, 4);
    EXPECT_NEAR(h.sum, kSource + 2 * small_disc, 1e-5);
    EXPECT_NEAR(h.u * h.sum, 2 * kSource - 2 * 2 * small_disc, 1e-5);
    EXPECT_NEAR(h.v * h.sum, -kSource + 2 * 2 * small_disc, 1e-5);
}

}  // namespace
}  // namespace hord::sim
