// A scene's own solids against closed forms and against the presets.
#include "hal_sim/optics/scene/shapes.h"

#include <cmath>
#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "hal_sim/optics/camera/render.h"
#include "hal_sim/optics/trace/trace.h"
#include "lab/optics/truth.h"

namespace hord::sim {
namespace {

using ::testing::HasSubstr;
using Kind = Shape::Kind;

Shape shape(Kind kind, const Vec3& position = {}, const Vec3& rotation = {}) {
    Shape s;
    s.kind = kind;
    s.position_mm = position;
    s.rotation_rad = rotation;
    return s;
}
Shape sphere(double radius, const Vec3& at) {
    Shape s = shape(Kind::sphere, at);
    s.radius_mm = radius;
    return s;
}
Shape block(const Vec3& half, const Vec3& at = {}) {
    Shape s = shape(Kind::block, at);
    s.half_size_mm = half;
    return s;
}
Shape tube(double radius, double half_height) {
    Shape s = shape(Kind::cylinder);
    s.radius_mm = radius, s.half_height_mm = half_height;
    return s;
}
Shape join(Kind kind, std::vector<Shape> of) {
    Shape s = shape(kind);
    s.of = std::move(of);
    return s;
}
Body body(const Part& part, const Pose& pose = {}) {
    Scene scene;
    scene.part = part;
    scene.pose = pose;
    EXPECT_TRUE(problems(scene).empty()) << problems(scene).front().message();
    return body_of(scene, true);
}
// A flat face towards the source at z = -2, this surface towards the camera, within a cylinder of radius 10.
Body plano(const Shape& face) { return body(SolidPart{join(Kind::intersection, {face, tube(10, 2)}), 1.5}); }

Shape asphere(double radius, double conic, std::vector<double> coefficients = {}, double z = 1) {
    Shape s = shape(Kind::asphere, {0, 0, z});
    s.radius_of_curvature_mm = radius, s.conic = conic, s.coefficients = std::move(coefficients);
    return s;
}

TEST(Shapes, a_lens_of_two_spheres_and_a_cylinder_is_the_preset) {
    const DoubleConvexLens lens;
    const double half = 2 + (190 - std::sqrt(190.0 * 190 - 100));
    const Body own = body(SolidPart{
        join(Kind::intersection, {sphere(190, {0, 0, half - 190}), sphere(190, {0, 0, 190 - half}), tube(10, 3)}),
        1.5});
    const Body preset = body(lens);
    for (double x = -10.4; x < 10.4; x += 0.31) {
        const Arrival a = trace(own, {x, 0.7, 0.02, -0.01}), b = trace(preset, {x, 0.7, 0.02, -0.01});
        EXPECT_NEAR(a.u, b.u, 1e-13) << x;
        EXPECT_NEAR(a.v, b.v, 1e-13) << x;
        EXPECT_EQ(a.weight, b.weight) << x;
    }
}

TEST(Shapes, an_asphere_without_asphericity_is_a_sphere) {
    const Body round = plano(sphere(80, {0, 0, 1 - 80})), same = plano(asphere(-80, 0));
    for (double x = -9.8; x < 9.8; x += 0.27) {
        const Arrival a = trace(round, {x, 1.3, 0.03, 0.01}), b = trace(same, {x, 1.3, 0.03, 0.01});
        EXPECT_NEAR(a.u, b.u, 1e-12) << x;
        EXPECT_NEAR(a.v, b.v, 1e-12) << x;
    }
}

TEST(Shapes,
     a_hyperboloid_brings_collimated_light_to_one_point) {  // conic -n^2: Descartes; at R / (n - 1) from the vertex
    const Body lens = plano(asphere(-60, -1.5 * 1.5));
    for (const double x : {0.01, 1.0, 4.0, 9.5}) {
        const Landing out = shine(lens, x, 0);
        EXPECT_NEAR(out.x + out.u * (1 + 60 / 0.5), 0, 1e-9) << x;  // its line at the focus; (x, u) are those on z = 0
    }
}

TEST(Shapes, a_surface_of_the_fourth_power_bends_by_its_slope) {
    const double a4 = 2e-5;
    const Body plate = plano(asphere(1e6, 0, {a4}));
    for (const double x : {0.5, 3.0, 8.0}) {
        const double slope = 4 * a4 * x * x * x + x / 1e6 / std::sqrt(1 - x * x / 1e12);
        const double angle = std::atan(slope);
        EXPECT_NEAR(shine(plate, x, 0).u, -std::tan(angle - std::asin(1.5 * std::sin(angle))), 1e-11) << x;
    }
}

TEST(Shapes,
     light_retraces_its_way_through_an_asphere_with_a_wave_on_it) {  // not convex: it may be met more than twice
    const Body wavy = plano(asphere(-40, 0.5, {6e-5, -9e-7}, 0.5));
    int seen = 0;
    for (double x = -9; x < 9; x += 0.17) {
        const Landing out = shine(wavy, x, 0.4);
        if (out.path == 0 || std::hypot(out.u, out.v) > 0.5) continue;
        const Arrival back = trace(wavy, {out.x, out.y, out.u, out.v});
        EXPECT_NEAR(back.u, 0, 1e-10) << x;
        EXPECT_NEAR(back.v, 0, 1e-10) << x;
        ++seen;
    }
    EXPECT_GT(seen, 90);
}

TEST(Shapes, a_cone_bends_all_light_by_one_angle) {  // an axicon
    Shape tip = shape(Kind::cone, {0, 0, 2}, {3.14159265358979323846, 0, 0});
    tip.radius_mm = 12, tip.height_mm = 2.4;  // opens towards the source; its wall falls by 0.2
    const Body axicon = plano(tip);
    const double angle = std::atan(0.2);
    for (const double x : {0.1, 2.0, 7.0, 9.9}) {
        EXPECT_NEAR(shine(axicon, x, 0).u, std::tan(angle - std::asin(1.5 * std::sin(angle))), 1e-12) << x;
        EXPECT_NEAR(shine(axicon, 0, -x).v, -std::tan(angle - std::asin(1.5 * std::sin(angle))), 1e-12) << x;
    }
}

TEST(Shapes, what_is_cut_away_is_air) {
    const Body own = body(SolidPart{join(Kind::difference, {block({8, 8, 2}), sphere(0.5, {1, 0, 0.3})}), 1.5});
    Scene scene;
    scene.part = Plate{};
    scene.defects = {AirBubble{{1, 0, 0.3}, 0.5}};
    const Body bubble = body_of(scene, true);
    for (double x = -0.2; x < 2.2; x += 0.013) {
        const Arrival a = trace(own, {x, 0.1, 0.01, 0}), b = trace(bubble, {x, 0.1, 0.01, 0});
        EXPECT_EQ(a.weight, b.weight) << x;
        EXPECT_NEAR(a.u, b.u, 1e-12) << x;
    }
    EXPECT_EQ(own.features.size(), 1U);  // and is refined as finely
}

TEST(Shapes, halves_that_touch_are_one_whole_and_apart_they_are_two) {
    const Body one =
        body(SolidPart{join(Kind::union_of, {block({8, 8, 1}, {0, 0, -1}), block({8, 8, 1}, {0, 0, 1})}), 1.5});
    const Body two =
        body(SolidPart{join(Kind::union_of, {block({8, 8, 1}, {0, 0, -1}), block({8, 8, 1}, {0, 0, 1.5})}), 1.5});
    Scene fresnel;
    fresnel.effects.fresnel = true;
    for (const double u : {0.0, 0.05, -0.3}) {
        EXPECT_NEAR(trace(one, {1, 2, u, 0}).u, u, 1e-15);
        EXPECT_NEAR(trace(two, {1, 2, u, 0}).u, u, 1e-15);
    }
    fresnel.part = SolidPart{join(Kind::union_of, {block({8, 8, 1}, {0, 0, -1}), block({8, 8, 1}, {0, 0, 1})}), 1.5};
    EXPECT_NEAR(trace(body_of(fresnel, true), {1, 2, 0, 0}).weight, 0.96 * 0.96, 1e-14);  // no face between them
    fresnel.part = SolidPart{join(Kind::union_of, {block({8, 8, 1}, {0, 0, -1}), block({8, 8, 1}, {0, 0, 1.5})}), 1.5};
    EXPECT_NEAR(trace(body_of(fresnel, true), {1, 2, 0, 0}).weight, std::pow(0.96, 4), 1e-14);
}

TEST(Shapes, each_is_turned_about_x_y_z_and_then_moved) {
    // A wedge: the half-space's face, tilted about y, is the preset's, whose camera-side face rises to the right.
    const double tilt = 0.06;
    const Body own = body(SolidPart{
        join(Kind::intersection, {shape(Kind::half_space, {0, 0, 2}, {0, -tilt, 0}), block({8, 8, 5}, {0, 0, 3})}),
        1.5});
    EXPECT_NEAR(shine(own, 0.3, -0.2).u, std::tan(std::asin(1.5 * std::sin(tilt)) - tilt), 1e-12);
    // Turned by a quarter about z within a group, to the bottom.
    Shape group =
        join(Kind::intersection, {shape(Kind::half_space, {0, 0, 2}, {0, -tilt, 0}), block({8, 8, 5}, {0, 0, 3})});
    group.rotation_rad = {0, 0, 1.57079632679489661923};
    EXPECT_NEAR(shine(body(SolidPart{group, 1.5}), 0.3, -0.2).v, std::tan(std::asin(1.5 * std::sin(tilt)) - tilt),
                1e-12);
}

TEST(Pose, a_tilted_plate_shifts_light_by_its_closed_form) {
    for (const double tilt : {0.1, 0.4, -0.3}) {
        const double s = std::sin(tilt), shift = 4 * s * (1 - std::cos(tilt) / std::sqrt(2.25 - s * s));
        const Landing about_y = shine(body(Plate{}, {0, 0, 0, 0, tilt, 0}), 0.2, 0.1),
                      about_x = shine(body(Plate{}, {0, 0, 0, tilt, 0, 1.5}), 0.2, 0.1);
        EXPECT_NEAR(about_y.u, 0, 1e-14);
        EXPECT_NEAR(std::abs(about_y.x - 0.2), std::abs(shift), 1e-12);
        EXPECT_NEAR(std::abs(about_x.y - 0.1), std::abs(shift), 1e-12);
        EXPECT_NEAR(about_x.x, 0.2, 1e-14);
    }
}

TEST(Pose, defects_move_with_the_part) {
    Scene scene;
    scene.part = Plate{};
    scene.defects = {AirBubble{{4, 0, 0}, 0.5}};
    scene.pose.tilt_y_rad = 0.5;
    scene.pose.z_mm = 0.7;
    const lab::Truth truth = lab::truth_of(scene);
    ASSERT_EQ(truth.defects.size(), 1U);
    // Seen from the axis: at 4 cos(0.5), and shifted by the glass before it, 2 mm of 4.
    const double s = std::sin(0.5), shift = 2 * s * (1 - std::cos(0.5) / std::sqrt(2.25 - s * s));
    EXPECT_NEAR(std::abs(truth.defects[0].m - (55 + 4 * std::cos(0.5) / (24.0 / 111))), shift / (24.0 / 111), 0.2);
    EXPECT_NEAR(truth.defects[0].n, 55, 0.2);
}

std::string refusal(const std::string& text) {
    const auto file = std::filesystem::path(::testing::TempDir()) / "shapes_refusal.toml";
    std::ofstream(file) << text;
    const auto scene = load_scene(file);
    return scene ? std::string("accepted") : scene.error().message();
}

TEST(Waviness, is_read_of_plates_and_refused_of_other_parts) {
    const std::string wave = "[part.waviness]\nwavefront_nm = 500\nperiod_mm = 3\n";
    EXPECT_EQ(refusal("[part]\nkind = \"plate\"\n" + wave), "accepted");
    EXPECT_NE(refusal("[part]\nkind = \"wedge\"\n" + wave).find("waviness"), std::string::npos);
    EXPECT_NE(refusal("[part]\nkind = \"plate\"\n[part.waviness]\nperiod_mm = 0\n").find("use 0.01 to 10000"),
              std::string::npos);
}

TEST(Shapes, are_read_nested_and_refused_with_line_and_cure) {
    const std::string good = R"([part]
kind = "solid"
refractive_index = 1.6
[part.shape]
kind = "difference"
[[part.shape.of]]
kind = "intersection"
[[part.shape.of.of]]
kind = "asphere"
radius_of_curvature_mm = -60
conic = -2.25
coefficients = [1e-6, 0]
position_mm = [0, 0, 1]
[[part.shape.of.of]]
kind = "cylinder"
radius_mm = 9
half_height_mm = 2
[[part.shape.of]]
kind = "sphere"
radius_mm = 0.4
)";
    EXPECT_EQ(refusal(good), "accepted");
    const std::string bad = refusal(R"([part]
kind = "solid"
[part.shape]
kind = "intersection"
[[part.shape.of]]
kind = "cone"
radius_mm = -1
[[part.shape.of]]
kind = "difference"
[[part.shape.of.of]]
kind = "torus"
[[part.shape.of]]
kind = "sphere"
conic = 2
)");
    EXPECT_THAT(bad, HasSubstr(":7: part.shape.of[0].radius_mm: -1 is out of range"));
    EXPECT_THAT(bad, HasSubstr(":9: part.shape.of[1].kind: has too few shapes to work on"));
    EXPECT_THAT(bad, HasSubstr(":11: part.shape.of[1].of[0].kind: \"torus\" is not known"));
    EXPECT_THAT(bad, HasSubstr(":14: part.shape.of[2].conic: is not a known key"));
    EXPECT_THAT(refusal("[part]\nkind = \"solid\"\n[part.shape]\nkind = \"half-space\"\n"),
                HasSubstr("reaches to infinity: intersect it with a block or a cylinder"));
    EXPECT_THAT(refusal("[part]\nkind = \"solid\"\n[part.shape]\nkind = \"intersection\"\n[[part.shape.of]]\nkind = "
                        "\"sphere\"\n[[part.shape.of]]\nkind = "
                        "\"sphere\"\nposition_mm = [50, 0, 0]\n"),
                HasSubstr("its shapes do not meet"));
    EXPECT_THAT(refusal("[part]\nkind = \"solid\"\n[part.shape]\nkind = \"asphere\"\nradius_of_curvature_mm = 5\n"),
                HasSubstr("is larger than the conic"));
}

}  // namespace
}  // namespace hord::sim
