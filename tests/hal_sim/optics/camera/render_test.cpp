#include "hal_sim/optics/camera/render.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <string>

#include <gtest/gtest.h>

#include "tests/hal_sim/optics/camera/small_scene.h"

namespace hord::sim {
namespace {

TEST(Render, an_empty_field_shows_the_source_in_every_lenslet) {
    for (const algo::Extents e : {algo::Extents{5, 4, 9, 9}, {3, 7, 3, 5}, {4, 3, 8, 6}, {3, 3, 15, 15}}) {
        Scene scene;
        scene.camera.extents = e;
        const LightField field = *render(scene);
        ASSERT_EQ(field.bins.size(), e.lenslets() * static_cast<std::size_t>(e.bins()));
        for (int n = 0; n < e.n; ++n) {
            for (int m = 0; m < e.m; ++m) {
                const Hord h = hord(field, m, n);
                EXPECT_NEAR(h.sum, kPi * 0.61 * 0.61, 1e-6);
                EXPECT_NEAR(h.u, 0, 1e-6);
                EXPECT_NEAR(h.v, 0, 1e-6);
            }
        }
    }
}

TEST(Render, a_lens_has_the_jacobian_of_its_focal_length) {  // the paper's J = -I/f
    Scene scene = small(DoubleConvexLens{}, 41);
    scene.camera.extents = {41, 41, 11, 11};
    scene.light.source_radius_bins = 2;  // many bins: the mean is then the mean of the light, not of the bins
    const LightField field = *render(scene);
    const double pitch = 24.0 / 41, expected = -pitch / 190.757 / 0.015;
    const Hord right = hord(field, 26, 20), left = hord(field, 14, 20), up = hord(field, 20, 14),
               down = hord(field, 20, 26);
    EXPECT_NEAR((right.u - left.u) / 12, expected, 0.02 * std::abs(expected));
    EXPECT_NEAR((down.v - up.v) / 12, expected, 0.02 * std::abs(expected));
    EXPECT_NEAR(right.v - left.v, 0, 1e-6);
}

TEST(Render, a_wedge_bends_evenly_and_turns_with_its_pose) {
    Wedge wedge;
    wedge.tilt_x_rad = 0.0596;  // two bins to the right
    Scene scene = small(wedge, 41);
    const Hord straight = hord(*render(scene), 20, 20);
    scene.pose.rotation_rad = kPi / 2;  // x turns into y: downwards
    const Hord turned = hord(*render(scene), 20, 20);
    EXPECT_GT(straight.u, 1.5);
    EXPECT_NEAR(turned.v, straight.u, 1e-5);
    EXPECT_NEAR(turned.u, straight.v, 1e-5);
    scene.pose = {4, -2, 0};
    const LightField moved = *render(scene);
    EXPECT_NEAR(hord(moved, 20, 20).u, straight.u, 1e-5);
    EXPECT_NEAR(hord(moved, 8, 20).u, 0, 1e-6);  // the part has left this place
}

// Cells, shrinking and sampling against plain ray tracing.
void expect_the_light_of_rays(const Scene& scene, int count, const std::map<std::string, std::pair<int, int>>& places) {
    const CameraGeometry camera(scene);
    const Body body = body_of(scene, true);
    const double radius = scene.light.source_radius_bins;
    for (const auto& [what, place] : places) {
        const std::vector<double> cells = bins_of(scene, place.first, place.second);
        double rays[81] = {};
        constexpr int kBatch = 1000;
        const double roots[4] = {std::sqrt(2.0), std::sqrt(3.0), std::sqrt(5.0), std::sqrt(7.0)};
        double at[4] = {}, u[kBatch], v[kBatch];
        std::vector<CameraRay> batch(kBatch);
        std::vector<Arrival> arrivals(kBatch);
        for (int k = 0; k < count; k += kBatch) {
            for (std::size_t b = 0; b < kBatch; ++b) {
                for (int a = 0; a < 4; ++a) at[a] = std::fmod(at[a] + roots[a], 1.0);
                u[b] = 9 * at[0] - 4.5, v[b] = 9 * at[1] - 4.5;
                batch[b] =
                    camera.to_part(camera.lenslet_x_mm(place.first) + (at[2] - 0.5) * camera.pitch_mm(),
                                   camera.lenslet_y_mm(place.second) + (at[3] - 0.5) * camera.pitch_mm(), u[b], v[b]);
            }
            trace_many(body, batch, arrivals.data());
            for (std::size_t b = 0; b < kBatch; ++b) {
                double s = 0, t = 0;
                camera.to_camera(arrivals[b].u, arrivals[b].v, s, t);
                if (arrivals[b].weight > 0 && s * s + t * t < radius * radius) {
                    rays[static_cast<int>(v[b] + 4.5) * 9 + static_cast<int>(u[b] + 4.5)] +=
                        arrivals[b].weight * 81 / count;
                }
            }
        }
        double all_cells = 0, all_rays = 0;
        for (int k = 0; k < 81; ++k) {
            EXPECT_NEAR(cells[k], rays[k], 0.03) << what << " bin " << k % 9 << "," << k / 9;
            all_cells += cells[k], all_rays += rays[k];
        }
        EXPECT_NEAR(all_cells, all_rays, 0.03) << what;
    }
}

TEST(Render, cells_agree_with_a_million_rays) {
    Scene scene;
    scene.part = DoubleConvexLens{};
    scene.defects = {AirBubble{{0, 0, 0.3}, 0.5}, SphericalCut{{-4.5, -4.5, 2.657}, 1.5},
                     AbsorbingSpeck{{3, 4, 0}, 0.4, 0.2}};
    expect_the_light_of_rays(scene, 1'000'000,
                             {{"clear", {70, 50}},
                              {"rim, right", {101, 60}},
                              {"rim, upper left", {21, 23}},
                              {"bubble's flank", {53, 55}},
                              {"bubble", {55, 55}},
                              {"cut", {34, 34}},
                              {"cut's edge", {27, 34}},
                              {"speck's edge", {70, 73}},
                              {"free", {3, 100}}});
}

// A wall parallel to the light reflects light inside the glass, which leaves to the other side: a narrow third path
// besides the free light and the light through the glass, seen in other bins.
TEST(Render, light_reflected_by_a_side_wall_is_not_overlooked) {
    for (const double shift : {0.0, 0.07, -0.05}) {  // of the wall within its lenslet
        Scene scene;
        scene.part = Wedge{8, 4, 0.059940079, 0.034493194, 1.5, true};
        scene.pose.x_mm = shift, scene.pose.y_mm = -0.5 * shift;
        const std::string at = "wall at " + std::to_string(shift);
        expect_the_light_of_rays(scene, 500'000,
                                 {{at + ", right", {92, 55}}, {at + ", below", {55, 92}}, {at + ", left", {18, 50}}});
    }
}

TEST(Render, is_the_same_for_any_number_of_threads) {
    Scene scene = small(DoubleConvexLens{}, 31);
    scene.defects = {AirBubble{{1, 2, 0}, 0.5}};
    const LightField one = *render(scene, {1, {}}), three = *render(scene, {3, {}});
    ASSERT_EQ(one.bins.size(), three.bins.size());
    EXPECT_EQ(std::memcmp(one.bins.data(), three.bins.data(), one.bins.size() * sizeof(float)), 0);
}

TEST(Render, progress_grows_to_one) {
    double last = -1;
    bool grows = true;
    RenderOptions options{2, [&](double done) {
                              grows = grows && done >= last;
                              last = done;
                          }};
    ASSERT_TRUE(render(small(NoPart{}, 41), options));
    EXPECT_TRUE(grows);
    EXPECT_EQ(last, 1);
}

// Blocks light by the area of its shadow, although none of the lenslet's first nine rays meets it.
TEST(Render, a_bubble_smaller_than_a_lenslet_is_not_overlooked) {
    Scene scene;
    scene.part = DoubleConvexLens{};
    const double clean = hord(*render(scene), 56, 56).sum;
    scene.defects = {AirBubble{{0.24, 0.2, 0}, 0.02}};
    const double pitch = 24.0 / 111, shadow = kPi * 0.02 * 0.02 / (pitch * pitch);
    EXPECT_NEAR(hord(*render(scene), 56, 56).sum / clean, 1 - shadow, 0.25 * shadow);
}

}  // namespace
}  // namespace hord::sim
