// Single rays against closed forms, and in the worst cases of floating point.
#include "hal_sim/optics/trace/trace.h"

#include <cmath>

#include <gtest/gtest.h>

#include "hal_sim/optics/scene/exact_math.h"
#include "hal_sim/optics/trace/refraction.h"

namespace hord::sim {
namespace {

constexpr double kClosedForm = 1e-12;  // rad; rounding of a few crossings

Scene with(const Part& part) {
    Scene scene;
    scene.part = part;
    return scene;
}
Body clean(const Part& part) { return body_of(with(part), false); }
Body with_defect(const Part& part, const SceneDefect& defect) {
    Scene scene = with(part);
    scene.defects.push_back(defect);
    return body_of(scene, true);
}
Wedge plate(double thickness, double index) {
    Wedge wedge;
    wedge.centre_thickness_mm = thickness;
    wedge.refractive_index = index;
    return wedge;
}
DoubleConvexLens ball(double radius, double index) { return {radius, radius, 0, index}; }

TEST(ExactMath, agrees_with_libm) {
    for (double x = -40; x < 40; x += 0.0173) {
        EXPECT_NEAR(exact::atan2(x, 1), std::atan(x), 4e-16);
        EXPECT_NEAR(exact::exp(x), std::exp(x), 1e-15 * std::exp(x));
        if (x > 0) {
            EXPECT_NEAR(exact::log(x), std::log(x), 4e-16 * (1 + std::abs(std::log(x))));
        }
        double s = 0, c = 0;
        exact::sin_cos(x, s, c);
        EXPECT_NEAR(s, std::sin(x), 4e-16);
        EXPECT_NEAR(c, std::cos(x), 4e-16);
        EXPECT_NEAR(exact::atan2(x, 0.37 * x - 1), std::atan2(x, 0.37 * x - 1), 6e-16);
    }
}

TEST(Refraction, obeys_snell_at_every_angle_and_splits_all_the_light) {
    const Vec3 normal{0, 0, 1};
    for (const auto& [before, after] : {std::pair{1.0, 1.5}, {1.5, 1.0}, {1.33, 1.7}}) {
        for (double angle = 0; angle < 1.57; angle += 0.003) {
            const Refraction out = refract({std::sin(angle), 0, -std::cos(angle)}, normal, before, after);
            const double sine = before / after * std::sin(angle);
            ASSERT_EQ(out.reflected, sine >= 1) << angle;
            if (out.reflected) {
                EXPECT_NEAR(out.direction.z, std::cos(angle), kClosedForm);
                EXPECT_EQ(fresnel_transmission(out, before, after), 0);
                continue;
            }
            EXPECT_NEAR(out.direction.x, sine, kClosedForm);
            EXPECT_LT(out.direction.z, 0);
            EXPECT_NEAR(length(out.direction), 1, 1e-15);
            // R + T = 1 with R from the amplitudes in another form (Fresnel's sine and tangent laws).
            const double t = std::asin(sine);
            const double rs = std::sin(angle - t) / std::sin(angle + t), rp = std::tan(angle - t) / std::tan(angle + t);
            if (angle > 0.01) {
                EXPECT_NEAR(fresnel_transmission(out, before, after), 1 - 0.5 * (rs * rs + rp * rp), 1e-10);
            }
        }
    }
    EXPECT_NEAR(fresnel_transmission(refract({0, 0, -1}, normal, 1, 1.5), 1, 1.5), 0.96, 1e-15);
}

TEST(Refraction, takes_the_right_branch_one_microradian_from_critical) {
    const double critical = std::asin(1 / 1.5);
    for (const double off : {1e-3, 1e-4, 1e-6, 1e-9}) {
        const auto at = [&](double angle) {
            return refract({std::sin(angle), 0, -std::cos(angle)}, {0, 0, 1}, 1.5, 1.0);
        };
        const Refraction below = at(critical - off), above = at(critical + off);
        EXPECT_FALSE(below.reflected) << off;
        EXPECT_TRUE(above.reflected) << off;
        // To leading order the refracted ray leaves at sqrt(2 tan(critical) off) to the face.
        const double expected = std::sqrt(2 * off / std::tan(critical));
        EXPECT_NEAR(below.cos_out / (1.5 * std::cos(critical) / std::sqrt(1.25) * expected), 1, 2e-2) << off;
        EXPECT_TRUE(std::isfinite(below.direction.x + above.direction.x));
    }
}

TEST(Trace, light_that_meets_nothing_is_not_changed) {
    const Arrival arrival = trace(Body{}, {1, 2, 0.01, -0.03});
    EXPECT_EQ(arrival.u, 0.01);
    EXPECT_EQ(arrival.v, -0.03);
    EXPECT_EQ(arrival.weight, 1);
    EXPECT_EQ(arrival.path, kFreePath);
}

TEST(Trace, a_prism_bends_by_its_closed_form) {
    for (const double angle : {0.01, 0.06, 0.3}) {
        Wedge wedge = plate(8, 1.5);
        wedge.tilt_x_rad = angle;
        const double bend = std::asin(1.5 * std::sin(angle)) - angle;
        const Landing out = shine(clean(wedge), 0.3, -0.2);
        EXPECT_NEAR(out.u, std::tan(bend), kClosedForm);  // towards the thicker side
        EXPECT_NEAR(out.v, 0, kClosedForm);
    }
}

TEST(Trace, a_plate_shifts_and_does_not_bend) {
    const double thickness = 4, index = 1.5, angle = 0.4;
    RayPolyline way;
    const Arrival out = trace(clean(plate(thickness, index)), {0, 0, std::tan(angle), 0}, &way);
    EXPECT_NEAR(out.u, std::tan(angle), kClosedForm);
    ASSERT_EQ(way.count, 4);
    const Vec3 direction = unit(way.points[3] - way.points[2]);
    const Vec3 from_entry = way.points[2] - way.points[1];
    const Vec3 across = from_entry - dot(from_entry, direction) * direction;
    const double s = std::sin(angle);
    EXPECT_NEAR(length(across), thickness * s * (1 - std::cos(angle) / std::sqrt(index * index - s * s)), 1e-12);
}

TEST(Trace, a_ball_bends_by_its_closed_form_though_its_faces_coincide) {
    for (const double radius : {0.005, 3.0, 400.0}) {
        const Body body = clean(ball(radius, 1.5));
        for (const double share : {0.0, 0.1, 0.5, 0.9, 0.99}) {  // beyond, it turns back
            const double in = std::asin(share), inside = std::asin(share / 1.5);
            const Landing out = shine(body, share * radius, 0);
            ASSERT_NE(out.path, 0U) << share;
            EXPECT_NEAR(std::atan(out.u), -2 * (in - inside), 1e-11) << share;
        }
    }
}

TEST(Trace, a_thick_lens_bends_by_height_over_focal_length) {
    const DoubleConvexLens lens;
    const double r = lens.radius_of_curvature_mm, n = lens.refractive_index;
    const double thickness = lens.edge_thickness_mm + 2 * (r - std::sqrt(r * r - 100));
    EXPECT_NEAR(thickness, 4.5266807797945035, 1e-12);
    const double focal = 1 / ((n - 1) * (2 / r - (n - 1) * thickness / (n * r * r)));
    EXPECT_NEAR(focal, 190.75745447612246, 1e-10);
    const Body body = clean(lens);
    for (const double x : {-1e-3, 1e-3}) {  // spherical aberration there: (x / r)^2 = 3e-11 of the deflection
        const Landing out = shine(body, x, 0);
        EXPECT_NEAR(out.u, -x / focal, 1e-9 * std::abs(x / focal));
        // The Jacobian du/dx on the measurement plane is -1/f, except for the distance of the principal plane from it.
        const double principal = thickness / 2 * (1 - 1 / n);
        EXPECT_NEAR(out.u / out.x, -1 / focal, 1.1 * (thickness / 2 / n + principal) / (focal * focal));
    }
}

TEST(Trace, an_air_bubble_bends_by_its_closed_form_and_reflects_totally_at_its_flanks) {
    AirBubble bubble;
    bubble.radius_mm = 0.5;
    const Body body = with_defect(plate(4, 1.5), bubble);
    for (const double share : {0.01, 0.05, 0.2, 0.3}) {
        const double inside =
            2 * (std::asin(share) - std::asin(1.5 * share));  // in the glass, towards the axis if positive
        const Landing out = shine(body, share * 0.5, 0);
        EXPECT_NEAR(out.u, -std::tan(std::asin(1.5 * std::sin(inside))), 1e-11) << share;
    }
    const double grazing = 0.5 * (1 - 1e-6);  // reflected by twice the grazing angle
    const double bend = 2 * std::acos(1 - 1e-6);
    EXPECT_NEAR(shine(body, grazing, 0).u, std::tan(std::asin(1.5 * std::sin(bend))), 1e-9);
}

TEST(Trace, light_retraces_its_way) {
    AirBubble bubble;
    bubble.centre_mm = {3, 1, 0.4};
    bubble.radius_mm = 0.4;
    const Body body = with_defect(DoubleConvexLens{}, bubble);
    int seen = 0;
    for (double x = -9.7; x < 9.7; x += 0.37) {
        for (double y = -2; y < 2; y += 0.29) {
            const Landing out = shine(body, x, y);
            if (out.path == 0 || std::abs(out.u) > 3) continue;
            const Arrival back = trace(body, {out.x, out.y, out.u, out.v});
            if (std::hypot(out.u, out.v) < 0.3) {
                EXPECT_NEAR(back.u, 0, 1e-10) << x << " " << y;
                EXPECT_NEAR(back.v, 0, 1e-10) << x << " " << y;
                ++seen;
            }
        }
    }
    EXPECT_GT(seen, 600);
}

TEST(Trace, nothing_depends_on_the_unit_of_length) {
    for (const double scale : {1e-3, 1.0, 7.3, 1e3}) {
        DoubleConvexLens lens{190 * scale, 10 * scale, 4 * scale, 1.5};
        AirBubble bubble{{1 * scale, 0.5 * scale, -0.3 * scale}, 0.5 * scale};
        const Body body = with_defect(lens, bubble),
                   reference = with_defect(DoubleConvexLens{}, AirBubble{{1, 0.5, -0.3}, 0.5});
        for (double x = -10.2; x < 10.2; x += 0.41) {
            const Arrival a = trace(reference, {x, 0.47, 0.02, -0.01}),
                          b = trace(body, {x * scale, 0.47 * scale, 0.02, -0.01});
            ASSERT_EQ(a.path, b.path) << x;
            EXPECT_NEAR(a.u, b.u, 1e-10) << x;
            EXPECT_NEAR(a.v, b.v, 1e-10) << x;
        }
    }
}

TEST(Geometry, a_sphere_of_five_micrometres_is_met_exactly_from_a_metre_away) {
    const double r = 0.005;
    const Vec3 centre{1000, -700, 400};
    for (const double share : {0.0, 0.3, 0.9, 0.9999}) {
        const Surface sphere{Surface::Shape::sphere, centre, {0, 0, 1}, r};
        const Ray ray{{1000 + share * r, -700, 1400}, {0, 0, -1}};
        const double offset = ray.origin.x - centre.x;  // as rounded
        const double t = next_crossing(sphere, ray, false, false);
        const double depth = std::sqrt(r * r - offset * offset);
        EXPECT_NEAR(t, 1000 - depth, crossing_error(sphere, ray, t)) << share;
        const Vec3 normal = foot_of(sphere, ray.origin + t * ray.direction).normal;
        EXPECT_NEAR(normal.x, offset / r, 1e-9) << share;
        EXPECT_NEAR(normal.z, depth / r, 1e-9 / std::sqrt(1 - share * share)) << share;
    }
}

TEST(Geometry, crossings_stay_on_their_side_of_a_tangent) {
    const Surface sphere{Surface::Shape::sphere, {}, {0, 0, 1}, 2};
    const auto at = [&](double x) { return next_crossing(sphere, {{x, 0, 5}, {0, 0, -1}}, false, false); };
    EXPECT_EQ(at(2), kNever);
    EXPECT_EQ(at(2 + 1e-15), kNever);
    EXPECT_NEAR(at(2 - 1e-12), 5, 1e-5);
    // Marked as inside, but grazing by rounding: must leave here and not loop.
    EXPECT_EQ(next_crossing(sphere, {{2, 0, 0}, {0, 0, -1}}, true, true), 0);
    EXPECT_GE(next_crossing(sphere, {{2 + 1e-14, 0, 0}, {0, 0, -1}}, true, false), 0);
    // On the surface: the other end of the chord from inside, nothing from outside.
    EXPECT_NEAR(next_crossing(sphere, {{0, 0, 2}, {0, 0, -1}}, true, true), 4, 1e-15);
    EXPECT_EQ(next_crossing(sphere, {{0, 0, 2}, {0, 0, -1}}, false, true), kNever);
}

TEST(Trace, grazing_and_tangent_rays_give_numbers) {
    AirBubble bubble;
    bubble.radius_mm = 0.5;
    const Body body = with_defect(DoubleConvexLens{}, bubble);
    for (const double at : {0.5, -0.5, 10.0, -10.0}) {
        for (int step = -50; step <= 50; ++step) {
            for (const double unit_step : {1e-16, 1e-12, 1e-8, 1e-4}) {
                const Arrival out = trace(body, {at + step * unit_step, 0, 0, 0});
                ASSERT_TRUE(std::isfinite(out.u) && std::isfinite(out.v)) << at << " " << step << " " << unit_step;
            }
        }
    }
}

TEST(Trace, glass_of_the_air_s_index_is_not_there) {
    DoubleConvexLens lens;
    lens.refractive_index = 1;
    const Body body = clean(lens);
    for (double x = -11; x < 11; x += 0.13) {
        const Arrival out = trace(body, {x, 1, 0.05, -0.02});
        EXPECT_EQ(out.u, 0.05);
        EXPECT_EQ(out.v, -0.02);
        EXPECT_EQ(out.path, kFreePath);
    }
}

TEST(Trace, a_bubble_in_a_bubble_is_not_there_and_neither_is_one_outside) {
    Scene scene = with(DoubleConvexLens{});
    scene.defects = {AirBubble{{0, 0, 0}, 0.5}};
    const Body one = body_of(scene, true);
    scene.defects = {AirBubble{{0, 0, 0}, 0.5}, AirBubble{{0.1, 0, 0}, 0.2}, AirBubble{{0, 0, 0}, 0.5},
                     AirBubble{{0, 20, 0}, 0.5}};
    const Body nested = body_of(scene, true);
    for (double x = -0.6; x < 0.6; x += 0.007) {
        const Arrival a = trace(one, {x, 0.03, 0.01, 0}), b = trace(nested, {x, 0.03, 0.01, 0});
        EXPECT_NEAR(a.u, b.u, 1e-9) << x;
        EXPECT_NEAR(a.v, b.v, 1e-9) << x;
        EXPECT_EQ(a.weight, b.weight) << x;
    }
}

// A ray crosses eight nested balls and the lens at 18 faces. What the faces reflect and what they let through is all.
TEST(Trace, nested_inclusions_keep_all_the_light_that_they_do_not_reflect) {
    Scene scene = with(DoubleConvexLens{});
    const auto index = [](int k) { return 1.5 + 0.01 * k; };
    for (int k = 1; k <= 8; ++k) scene.defects.push_back(Inclusion{{0, 0, 0}, 0.9 - 0.1 * k, index(k)});
    const Body bare = body_of(scene, true);
    for (double x = -1; x < 1; x += 0.01) EXPECT_EQ(trace(bare, {x, 0.003, 0.001, 0}).weight, 1) << x;
    scene.effects.fresnel = true;
    double passes = 0.96;  // of one face of the lens
    for (int k = 1; k <= 8; ++k) passes *= 1 - std::pow((index(k) - index(k - 1)) / (index(k) + index(k - 1)), 2);
    EXPECT_NEAR(trace(body_of(scene, true), {0, 0, 0, 0}).weight, passes * passes, 1e-14);
}

TEST(Trace, a_speck_takes_its_share_of_the_light_and_only_that) {
    const Body body = with_defect(DoubleConvexLens{}, AbsorbingSpeck{{1, 2, 0}, 0.5, 0.25});
    const Body bare = clean(DoubleConvexLens{});
    const CameraRay hit{1.2, 2.1, -0.007, 0}, miss{1.2, 2.6, -0.007, 0};
    EXPECT_EQ(trace(body, hit).weight, 0.25);
    EXPECT_EQ(trace(body, miss).weight, 1);
    EXPECT_EQ(trace(body, hit).u, trace(bare, hit).u);
}

}  // namespace
}  // namespace hord::sim
