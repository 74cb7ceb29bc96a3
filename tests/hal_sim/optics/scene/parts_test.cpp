// The other presets, defects and effects, against closed forms.
#include <cmath>
#include <iterator>
#include <numeric>

#include <gtest/gtest.h>

#include "hal_sim/optics/camera/render.h"
#include "hal_sim/optics/trace/trace.h"
#include "lab/optics/truth.h"
#include "tests/hal_sim/optics/camera/small_scene.h"

namespace hord::sim {
namespace {

Body body(const Part& part, std::vector<SceneDefect> defects = {}, bool fresnel = false) {
    Scene scene;
    scene.part = part;
    scene.defects = std::move(defects);
    scene.effects.fresnel = fresnel;
    EXPECT_TRUE(problems(scene).empty()) << problems(scene).front().message();
    return body_of(scene, true);
}

TEST(Parts, a_plano_convex_lens_has_the_focal_length_of_its_one_face) {
    const Landing out = shine(body(PlanoConvexLens{}), 1e-3, 0);
    EXPECT_NEAR(out.u, -1e-3 * 0.5 / 100, 1e-9 * 1e-5);
}

TEST(Parts, a_cylinder_lens_bends_across_its_axis_only) {
    const Landing out = shine(body(CylinderLens{}), 1e-3, 3);
    EXPECT_NEAR(out.u, -1e-3 * 0.5 / 100, 1e-9 * 1e-5);
    EXPECT_NEAR(out.v, 0, 1e-15);
}

// A wave of the transmitted wavefront, peak to valley 800 nm over 2 mm: its slope is pi times their ratio at the most.
TEST(Parts, a_wavy_plate_deflects_by_the_slope_of_its_wavefront) {
    Plate plate{.half_size_mm = 8, .thickness_mm = 3};
    plate.waviness = {.wavefront_nm = 800, .period_mm = 2, .direction_rad = 0.5};
    const double most = 3.14159265358979 * 800e-6 / 2;
    const Body wavy = body(plate);
    const double c = std::cos(0.5), s = std::sin(0.5);
    for (const double along : {0.0, 0.3, 0.5, 1.0, 1.7}) {
        const Landing out = shine(wavy, along * c - 0.4 * s, along * s + 0.4 * c);  // the same all across
        EXPECT_NEAR(out.u * c + out.v * s, most * std::cos(3.14159265358979 * along), 1e-12) << along;
        EXPECT_NEAR(out.v * c - out.u * s, 0, 1e-15);
        // What the camera sees under that slope came straight from the source.
        const Arrival back = trace(wavy, {along * c, along * s, out.u, out.v});
        EXPECT_NEAR(back.u, 0, 1e-12);
        EXPECT_NEAR(back.v, 0, 1e-12);
    }
    EXPECT_EQ(shine(wavy, 9, 0).u, 0);  // beside the plate
    plate.waviness.phase_rad = 3.14159265358979;
    EXPECT_NEAR(shine(body(plate), 0, 0).u, -most * c, 1e-12);
    plate.waviness.wavefront_nm = 0;
    EXPECT_EQ(shine(body(plate), 0.3, 0.3).u, 0);
}

TEST(Parts, a_vial_filled_with_its_own_glass_is_a_rod) {
    const Body rod = body(Vial{6, 5, 10, 1.5, 1.5});
    for (const double share : {0.1, 0.5, 0.8}) {
        const double bend = 2 * (std::asin(share) - std::asin(share / 1.5));
        EXPECT_NEAR(std::atan(shine(rod, 6 * share, 1).u), -bend, 1e-11) << share;
    }
    // Empty, a thin wall is a weak diverging lens; full of water, a strong converging one.
    EXPECT_GT(shine(body(Vial{6, 5, 10, 1.5, 1}), 1, 0).u, 0);
    EXPECT_LT(shine(body(Vial{6, 5, 10, 1.5, 1.33}), 1, 0).u, -0.05);
}

TEST(Parts, an_inclusion_of_the_part_s_index_is_not_there_and_another_bends_the_other_way_than_a_bubble) {
    const Plate plate;
    const CameraRay ray{0.1, 0, 0, 0};
    EXPECT_EQ(trace(body(plate, {Inclusion{{0, 0, 0}, 0.5, 1.5}}), ray).u, 0);
    const double dense = trace(body(plate, {Inclusion{{0, 0, 0}, 0.5, 1.7}}), ray).u;
    const double hollow = trace(body(plate, {AirBubble{{0, 0, 0}, 0.5}}), ray).u;
    EXPECT_LT(dense * hollow, 0);
}

TEST(Parts, a_scratch_is_a_groove_of_its_length) {
    const Body scratched = body(Plate{}, {Scratch{{-2, -1, 2}, {2, -1, 2}, 0.05}});
    const auto bends = [&](double x, double y) { return trace(scratched, {x, y, 0, 0}).v != 0; };
    EXPECT_TRUE(bends(0, -1.02));
    EXPECT_TRUE(bends(1.9, -0.98));
    EXPECT_FALSE(bends(2.1, -0.98));
    EXPECT_FALSE(bends(0, -0.9));
    Scene scene;
    scene.part = Plate{};
    scene.defects = {Scratch{{-2, -1, 2}, {2, -1, 2}, 0.05}};
    const lab::Truth truth = lab::truth_of(scene);
    ASSERT_EQ(truth.defects.size(), 1U);
    EXPECT_NEAR(truth.defects[0].m, 55, 0.1);
    EXPECT_NEAR(truth.defects[0].n, 55 - 1 / (24.0 / 111), 0.1);
    EXPECT_GE(truth.defects[0].area_lenslets, 18U);
    const auto sum = [&](int m, int n) {
        const std::vector<double> bins = bins_of(scene, m, n);
        return std::accumulate(bins.begin(), bins.end(), 0.0);
    };
    EXPECT_LT(sum(55, 50), 0.7 * sum(55, 55));  // a tenth of a millimetre of 0.216 bends its light away
    EXPECT_NEAR(sum(67, 50), sum(55, 55), 1e-3);
}

TEST(Parts, a_soft_stria_deflects_its_two_halves_by_twice_its_index_difference_and_nothing_beside_it) {
    constexpr double kDifference = 0.01, kPlate = 1.5, kStria = kPlate + kDifference;
    // The closed form of a prism whose flank is as steep as 2, within a plate.
    const double flank = std::atan(2.0);
    const double inside = flank - std::asin(std::sin(flank) * kPlate / kStria);
    const double expected = std::tan(std::asin(kStria * std::sin(inside)));
    EXPECT_NEAR(expected, 2 * kDifference, 0.02 * 2 * kDifference);
    const Body soft = body(Plate{}, {Stria{{0, -2, 0}, {0, 2, 0}, 0.1, kDifference, true}});
    const auto at = [&](double x, double y) { return trace(soft, {x, y, 0, 0}); };
    for (const double x : {0.03, 0.05, 0.08}) {
        EXPECT_NEAR(at(x, 0.3).u, -at(-x, 0.3).u, 1e-9) << x;
        EXPECT_NEAR(std::abs(at(x, 0.3).u), expected, 1e-9) << x;
        EXPECT_NEAR(at(x, 0.3).v, 0, 1e-9) << x;
    }
    EXPECT_EQ(at(0.11, 0.3).u, 0);
    EXPECT_EQ(at(0.05, 2.1).u, 0);
}

TEST(Parts, a_soft_inclusion_deflects_evenly_up_to_its_rim_and_nothing_beside_it) {
    constexpr double kRadius = 0.5, kDifference = 0.008;
    const Body soft = body(Plate{}, {Inclusion{{0, 0, 0}, kRadius, 1.5 + kDifference, 0, true}});
    const auto at = [&](double x) { return trace(soft, {x, 0, 0, 0}).u; };
    // Thin caps: twice the difference times the slope of a cap with radius 17/8 of the rim's.
    for (const double x : {0.05, 0.2, 0.35, 0.49}) {
        const double slope = std::tan(std::asin(x / (17.0 / 8 * kRadius)));
        EXPECT_NEAR(std::abs(at(x)), 2 * kDifference * slope, 0.02 * kDifference) << x;
        EXPECT_NEAR(at(x), -at(-x), 1e-12) << x;
    }
    EXPECT_NEAR(std::abs(at(0.4999)), Inclusion::kSoftRim * kDifference, 0.02 * kDifference);
    EXPECT_EQ(at(0.501), 0);
}

// The sphere of a shallow cut is much larger than its bite: it made every cell of the part a small one.
TEST(Parts, a_cut_is_looked_at_closely_only_where_it_bites) {
    constexpr double kRim = 0.9, kSphere = 50;
    const Plate plate{8, 4, 1.5};
    const Body flat = body(plate, {Dimple{{1, 2, 2 + std::sqrt(kSphere * kSphere - kRim * kRim)}, kSphere}});
    ASSERT_EQ(flat.features.size(), 1U);
    EXPECT_NEAR(flat.features[0].reach, kRim, 1e-9);
    EXPECT_NEAR(length(flat.features[0].from - Vec3{1, 2, 2}), 0, 1e-9);
    // On a lens the rim's plane cuts both spheres.
    const DoubleConvexLens lens;
    const double r = lens.radius_of_curvature_mm, top = 2 + r - std::sqrt(r * r - 100);
    const double sag_lens = r - std::sqrt(r * r - kRim * kRim),
                 sag_cut = kSphere - std::sqrt(kSphere * kSphere - kRim * kRim);
    const Body round = body(lens, {SphericalCut{{0, 0, top - sag_lens - sag_cut + kSphere}, kSphere}});
    EXPECT_NEAR(round.features[0].reach, kRim, 1e-9);
    // More than half of a sphere in the glass: all of it.
    EXPECT_EQ(body(plate, {SphericalCut{{0, 0, 1.9}, 1}}).features[0].reach, 1);
}

TEST(Effects, fresnel_takes_four_percent_a_face_and_nothing_when_off) {
    const CameraRay ray{1, 1, 0, 0};
    EXPECT_EQ(trace(body(Plate{}), ray).weight, 1);
    EXPECT_NEAR(trace(body(Plate{}, {}, true), ray).weight, 0.96 * 0.96, 1e-14);
    EXPECT_NEAR(trace(body(Plate{}, {AirBubble{{1, 1, 0}, 0.5}}, true), ray).weight, std::pow(0.96, 4), 1e-14);
}

}  // namespace
}  // namespace hord::sim
