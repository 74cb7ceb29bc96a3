// The optical power of lenses whose focal length has a closed form.
#include "algo/maps/optical_map.h"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "algo/frame/mask.h"
#include "common/statistics.h"
#include "hal_sim/optics/camera/render.h"

namespace hord::algo {
namespace {

constexpr double kOnePercent = 0.01;
constexpr LightLevels kExact{0, 30, 65535};

sim::Scene lens_in_view(const sim::Part& part) {
    sim::Scene scene;
    scene.part = part;
    scene.camera.extents = {41, 41, 9, 9};
    scene.camera.field_mm = 8;  // its middle alone
    scene.camera.bin_pitch_rad = 0.01;
    scene.camera.bits = 16;
    scene.camera.full_bin_dn = 60000;
    scene.light.source_radius_bins = 0.61;  // of all, its mean deflection in bins is straightest: J1(2 pi 0.61) = 0
    return scene;
}

OpticalMap map_of(const sim::Scene& scene, Optical what, bool with_scale = true) {
    const auto light = sim::render(scene, {1, {}});
    const Frame frame = sim::expose(*light, scene, 1);
    const OpticalScale scale{scene.camera.field_mm / scene.camera.extents.m, scene.camera.bin_pitch_rad};
    return *optical_map(frame.view(), scene.camera.extents, 16, kExact, what, with_scale ? scale : OpticalScale{});
}

double median_of(const OpticalMap& map) {
    std::vector<float> values;
    for (std::size_t k = 0; k < map.values.size(); ++k) {
        if (map.mask[k] == kValid) values.push_back(map.values[k]);
    }
    EXPECT_GT(values.size(), 1000U);
    return values.empty() ? 0 : static_cast<double>(common::upper_median(std::span(values)));
}

// The lens maker's equation of a biconvex lens in air: power in dioptres, and how far its rear principal plane lies
// before its rear vertex.
struct Thick {
    double power, plane_mm;
};
Thick biconvex(double radius_mm, double thickness_mm, double n) {
    const double surface = (n - 1) / radius_mm;  // 1/mm
    const double power = 2 * surface - surface * surface * thickness_mm / n;
    return {1e3 * power, surface / power * thickness_mm / n};
}

TEST(OpticalMap, power_of_a_thin_lens_is_one_over_its_focal_length_to_one_percent) {
    // 0.05 mm thick at its rim, 10 mm: 1 mm in the middle, f = 100.
    const sim::DoubleConvexLens lens{100, 10, 0.05, 1.5};
    const OpticalMap map = map_of(lens_in_view(lens), Optical::power);
    EXPECT_NEAR(median_of(map), 1e3 * 2 * 0.5 / 100, 1e3 * 2 * 0.5 / 100 * kOnePercent);
}

TEST(OpticalMap, power_of_a_thick_lens_is_that_of_the_closed_form_to_one_percent) {
    // 22 mm thick: the thin lens's power would be 4 % off, and the plane of measurement another 5 %.
    const sim::DoubleConvexLens lens{100, 6, 21.6, 1.6};
    const double thickness = 21.6 + 2 * (100 - std::sqrt(100.0 * 100.0 - 6 * 6));
    const Thick thick = biconvex(100, thickness, 1.6);
    const double plane_z = thickness / 2 - thick.plane_mm, focus_z = plane_z + 1e3 / thick.power;
    const double expected = 1e3 / focus_z;  // from the plane z = 0
    const double thin = 1e3 * 2 * 0.6 / 100;
    ASSERT_GT(std::abs(thin / expected - 1), 2 * kOnePercent);  // the test tells thick from thin
    EXPECT_NEAR(median_of(map_of(lens_in_view(lens), Optical::power)), expected, expected * kOnePercent);
}

TEST(OpticalMap, cylinder_of_a_cylinder_lens_is_twice_its_mean_power_and_a_sphere_has_none) {
    const sim::CylinderLens lens{100, 8, 9, 0.5, 1.5};
    const sim::Scene scene = lens_in_view(lens);
    const double power = median_of(map_of(scene, Optical::power)),
                 cylinder = median_of(map_of(scene, Optical::cylinder));
    EXPECT_NEAR(cylinder, 1e3 * 0.5 / 100, 1e3 * 0.5 / 100 * 0.02);
    EXPECT_NEAR(2 * power, cylinder, 0.02 * cylinder);
    EXPECT_LT(median_of(map_of(lens_in_view(sim::DoubleConvexLens{100, 10, 0.05, 1.5}), Optical::cylinder)), 0.02 * 10);
}

TEST(OpticalMap, deflection_of_a_wedge_is_its_angle_times_index_less_one) {
    sim::Wedge wedge;
    wedge.half_size_mm = 8;
    wedge.tilt_x_rad = 0.03;
    const sim::Scene scene = lens_in_view(wedge);
    // Snell at the tilted face.
    const double expected = std::tan(std::asin(1.5 * std::sin(0.03)) - 0.03);
    EXPECT_NEAR(median_of(map_of(scene, Optical::deflection_x)), 1e3 * expected, 1e3 * expected * kOnePercent);
    EXPECT_NEAR(median_of(map_of(scene, Optical::deflection_y)), 0, 0.02);
    EXPECT_NEAR(median_of(map_of(scene, Optical::deflection_x, false)), expected / 0.01, expected / 0.01 * kOnePercent);
}

TEST(OpticalMap, power_without_a_scale_is_refused_with_the_cure_and_beside_the_dark_there_is_none) {
    sim::Scene scene = lens_in_view(sim::DoubleConvexLens{100, 10, 0.05, 1.5});
    scene.defects = {sim::AbsorbingSpeck{{0, 0, 0}, 0.3, 0}};
    const auto light = sim::render(scene, {1, {}});
    const Frame frame = sim::expose(*light, scene, 1);
    const Extents e = scene.camera.extents;
    const auto refused = optical_map(frame.view(), e, 16, kExact, Optical::power, {});
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().message(), ::testing::HasSubstr("[scale] lenslet_mm and bin_rad"));
    const auto map = optical_map(frame.view(), e, 16, kExact, Optical::power, {0.2, 0.01});
    ASSERT_TRUE(map);
    EXPECT_NE(map->mask[e.index(20, 20)] & kDark, 0);
    EXPECT_EQ(map->mask[e.index(20, 22)], kBorder);  // a neighbour within two lenslets is dark
    EXPECT_EQ(map->mask[e.index(20, 26)], kValid);
    EXPECT_EQ(map->mask[e.index(1, 20)], kBorder);
}

}  // namespace
}  // namespace hord::algo
