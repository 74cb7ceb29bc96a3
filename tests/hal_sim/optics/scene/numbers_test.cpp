// Accuracy at any position and size of a scene, and at the edge cases of branches.
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "hal_sim/optics/trace/trace.h"

namespace hord::sim {
namespace {

constexpr double kAngle = 1e-9;  // rad

Body body(const Part& part, std::vector<SceneDefect> defects = {}, bool fresnel = false) {
    Scene scene;
    scene.part = part;
    scene.defects = std::move(defects);
    scene.effects.fresnel = fresnel;
    return body_of(scene, true);
}
// The same ray, for a body that was moved.
CameraRay moved(const CameraRay& ray, const Vec3& by) {
    return {ray.x + by.x - ray.u * by.z, ray.y + by.y - ray.v * by.z, ray.u, ray.v};
}

TEST(Numbers, nothing_depends_on_where_the_part_lies) {
    const Body here = body(DoubleConvexLens{}, {AirBubble{{1, 0.5, -0.3}, 0.5}, Scratch{{-3, 0, 2}, {-1, 1, 2}, 0.2}});
    for (const Vec3& by : {Vec3{5, -3, 0}, Vec3{0, 0, 30}, Vec3{1000, -700, 400}}) {
        Body there = here;
        there.move({{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, by});
        int bent = 0;
        for (double x = -10.31; x < 10.3; x += 0.173) {
            const CameraRay ray{x, 0.47, 0.02, -0.01};
            const Arrival a = trace(here, ray), b = trace(there, moved(ray, by));
            ASSERT_EQ(a.path, b.path) << x;
            EXPECT_NEAR(std::atan(a.u), std::atan(b.u), kAngle) << x;
            EXPECT_NEAR(std::atan(a.v), std::atan(b.v), kAngle) << x;
            bent += a.path != kFreePath && a.weight > 0;
        }
        EXPECT_GT(bent, 80);
    }
}

TEST(Numbers, a_bubble_of_five_micrometres_a_metre_away_bends_like_one_at_the_origin) {
    const double r = 0.005;
    const Body here = body(Plate{}, {AirBubble{{}, r}});
    Body there = here;
    const Vec3 by{1000, -700, 400};
    there.move({{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, by});
    for (const double share : {0.0, 0.05, 0.2, 0.3, 0.5}) {  // beyond 2/3 all is reflected
        const CameraRay ray{share * r, 0, 0, 0};
        const CameraRay far = moved(ray, by);
        const double as_rounded = far.x - by.x;  // a metre's last place is 2e-11 of the radius
        const Arrival a = trace(here, {as_rounded, 0, 0, 0}), b = trace(there, far);
        ASSERT_EQ(a.path, b.path) << share;
        EXPECT_NEAR(std::atan(a.u), std::atan(b.u), kAngle) << share;
        const double turn = 2 * (std::asin(as_rounded / r) - std::asin(1.5 * as_rounded / r));  // in the glass
        EXPECT_NEAR(std::abs(std::atan(b.u)), std::abs(std::asin(1.5 * std::sin(turn))), kAngle) << share;
    }
}

TEST(Numbers, a_thin_lens_bends_by_height_over_focal_length_everywhere) {  // J = -I/f
    const double r = 190, focal = r / (2 * 0.5);
    const Body lens = body(DoubleConvexLens{r, 0.1, 0, 1.5});
    for (const double x : {-0.08, -0.03, 0.05}) {
        for (const double y : {-0.04, 0.0, 0.05}) {
            const Landing out = shine(lens, x, y);
            EXPECT_NEAR(out.u, -x / focal, kAngle);
            EXPECT_NEAR(out.v, -y / focal, kAngle);
        }
    }
}

// A prism whose second face is met at the critical angle plus or minus one microradian.
TEST(Numbers, a_prism_one_microradian_from_total_reflection_takes_the_right_branch) {
    const double critical = std::asin(1 / 1.5);
    for (const double off : {1e-3, 1e-6, 1e-9}) {
        const auto lit = [&](double tilt, RayPolyline& way) {
            Wedge wedge;
            wedge.half_size_mm = 1, wedge.centre_thickness_mm = 4, wedge.tilt_x_rad = tilt;
            return shine(body(wedge), 0.1, 0, &way);
        };
        RayPolyline way;
        const Landing below = lit(critical - off, way);
        ASSERT_NE(below.path, 0U) << off;
        const double turned = std::asin(1.5 * std::sin(critical - off)) - (critical - off);
        // The rounding error of the angle, 1e-16, is amplified by the inverse cosine of the exit angle.
        EXPECT_NEAR(std::atan(below.u), turned, 1e-15 / std::cos(turned + critical - off) + 1e-15) << off;
        const Landing above = lit(critical + off, way);
        ASSERT_GE(way.count, 4);  // continues inside, in the mirrored direction
        EXPECT_TRUE(way.in_part[3]) << off;
        const Vec3 on = unit(way.points[3] - way.points[2]);
        EXPECT_NEAR(std::atan2(on.x, on.z), 3.14159265358979323846 - 2 * (critical + off), kAngle) << off;
        EXPECT_TRUE(above.path == 0 || (above.path & kMirrored) != 0) << off;
    }
}

TEST(Numbers, parts_without_thickness_and_faces_that_only_touch_do_nothing) {
    for (double x = -8.9; x < 9; x += 0.31) {
        const CameraRay ray{x, 0.7, 0.03, -0.02};
        const Arrival thin = trace(body(Plate{8, 1e-6, 1.5}), ray);
        if (thin.weight > 0) {
            EXPECT_NEAR(thin.u, ray.u, 1e-14);
            EXPECT_NEAR(thin.x, ray.x, 1e-7);
        }
        // A cut that touches the face from outside, a bubble that touches it from inside, an inclusion of the same
        // index, a stria of none.
        const Arrival bare = trace(body(Plate{}), ray);
        for (const SceneDefect& nothing :
             {SceneDefect{SphericalCut{{0, 0.7, 3}, 1}}, SceneDefect{Inclusion{{0, 0.7, 0}, 1, 1.5}},
              SceneDefect{Stria{{-5, 0.7, 0}, {5, 0.7, 0}, 0.3, 0}}}) {
            const Arrival same = trace(body(Plate{}, {nothing}), ray);
            EXPECT_NEAR(same.u, bare.u, 1e-12) << nothing.index() << " at " << x;
            EXPECT_EQ(same.weight, bare.weight) << nothing.index() << " at " << x;
        }
        const Arrival touched = trace(body(Plate{}, {AirBubble{{0, 0.7, 1}, 1}}), ray);
        EXPECT_TRUE(std::isfinite(touched.u) && std::isfinite(touched.v)) << x;
    }
}

// Coincident faces: of a plate, an inclusion-like solid beside it, and both with Fresnel's losses: no face where glass
// meets the same glass.
TEST(Numbers, no_light_is_lost_or_won_at_faces_that_coincide) {
    Shape one, two;
    one.kind = two.kind = Shape::Kind::block;
    one.half_size_mm = {4, 4, 1}, two.half_size_mm = {4, 4, 1};
    one.position_mm = {0, 0, -1}, two.position_mm = {0, 0, 1};
    Shape both;
    both.kind = Shape::Kind::union_of, both.of = {one, two};
    const Body split = body(SolidPart{both, 1.5}, {}, true);
    const Body whole = body(Plate{4, 4, 1.5}, {}, true);
    for (double x = -3.7; x < 3.8; x += 0.23) {
        for (const double u : {0.0, 0.05, -0.2}) {
            const Arrival a = trace(split, {x, 0.3, u, 0}), b = trace(whole, {x, 0.3, u, 0});
            EXPECT_NEAR(a.u, b.u, 1e-12) << x << " " << u;
            EXPECT_NEAR(a.weight, b.weight, 1e-12) << x << " " << u;
        }
    }
}

// Any surfaces in any order: results are finite, and the light never increases.
TEST(Numbers, every_ray_gives_numbers_and_no_more_light_than_there_was) {
    std::mt19937_64 random(3);
    const auto draw = [&](double half) { return half * (2 * static_cast<double>(random() >> 11) * 0x1p-53 - 1); };
    int bent = 0;
    for (int k = 0; k < 60; ++k) {
        std::vector<SceneDefect> defects;
        for (int d = 0; d < 5; ++d)
            defects.push_back(
                AirBubble{{draw(1), draw(1), draw(1)}, 0.1 + 0.4 * std::abs(draw(1))});  // nested, crossing, touching
        defects.push_back(defects.front());
        const Body many = k % 2 == 0 ? body(DoubleConvexLens{}, defects, true) : body(Vial{}, defects, true);
        for (int ray = 0; ray < 300; ++ray) {
            const Arrival out = trace(many, {draw(2), draw(2), draw(0.3), draw(0.3)});
            ASSERT_TRUE(std::isfinite(out.u) && std::isfinite(out.v) && std::isfinite(out.x) && std::isfinite(out.y));
            ASSERT_TRUE(out.weight >= 0 && out.weight <= 1) << out.weight;
            bent += out.weight > 0;
        }
    }
    EXPECT_GT(bent, 5000);
}

}  // namespace
}  // namespace hord::sim
