// How the cameras map positions and slopes: raw lenslet arrays, and the paper's Figures 1 and 2.
#include "hal_sim/optics/camera/camera.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <numeric>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "algo/frame/lenslet_grid.h"
#include "hal_sim/optics/camera/lenslet_light.h"
#include "hal_sim/optics/camera/render.h"
#include "lab/optics/views.h"
#include "tests/hal_sim/optics/camera/small_scene.h"

namespace hord::sim {
namespace {

using ::testing::HasSubstr;

Scene turned_hexagonal() {
    Scene scene;
    scene.part = DoubleConvexLens{};
    scene.camera.extents = {31, 33, 9, 7};
    scene.camera.array.hexagonal = true;
    scene.camera.array.pitch_px = 15.4;
    scene.camera.array.rotation_rad = 3 * 3.14159265358979323846 / 180;
    scene.camera.array.offset_x_px = 1.3, scene.camera.array.offset_y_px = -0.6;
    scene.camera.array.distortion = 0.004;
    scene.camera.array.width_px = 520, scene.camera.array.height_px = 500;
    return scene;
}

TEST(Array, an_aligned_one_of_a_pixel_a_bin_is_seen_as_the_macro_pixel_frame) {
    Scene scene;
    scene.part = DoubleConvexLens{};
    scene.camera.extents = {21, 19, 9, 9};
    const LightField field = *render(scene);
    const CameraPicture raw = *lab::render_raw(scene);
    ASSERT_EQ(raw.width_px, 21 * 9);
    ASSERT_EQ(raw.height_px, 19 * 9);
    for (std::size_t k = 0; k < raw.light.size(); ++k) ASSERT_NEAR(raw.light[k], field.bins[k], 1e-6) << k;
}

TEST(Array, lattice_and_place_are_inverse_to_each_other) {
    const Scene scene = turned_hexagonal();
    const ArrayGeometry array(scene);
    for (int n = 0; n < 33; ++n) {
        for (int m = 0; m < 31; ++m) {
            const auto back = array.to_lattice(array.place_mm(m, n));
            EXPECT_NEAR(back.x, m, 1e-9);
            EXPECT_NEAR(back.y, n, 1e-9);
        }
    }
    EXPECT_FALSE(array.is_plain());
    EXPECT_TRUE(ArrayGeometry(Scene{}).is_plain());
}

// The fitted grid's own model, written independently (algo/frame/lenslet_grid.h), says where the lenslets are.
algo::LensletGrid grid_of(const Scene& scene) {
    const LensletArray& array = scene.camera.array;
    algo::LensletGrid grid;
    grid.kind = algo::LatticeKind::hexagonal;
    grid.stagger = algo::Stagger::rows;
    grid.columns = scene.camera.extents.m, grid.rows = scene.camera.extents.n;
    grid.origin_u = 0.5 * (grid.columns - 1) + 0.25, grid.origin_v = std::sqrt(3.0) / 2 * 0.5 * (grid.rows - 1);
    grid.model = algo::GridModelKind::radial1;
    grid.width_px = array.width_px, grid.height_px = array.height_px;
    grid.middle_x_px = 0.5 * (array.width_px - 1), grid.middle_y_px = 0.5 * (array.height_px - 1);
    grid.radius_px = 0.5 * std::max(array.width_px, array.height_px);
    const double c = array.pitch_px * std::cos(array.rotation_rad), s = array.pitch_px * std::sin(array.rotation_rad);
    grid.parameters = {grid.middle_x_px + array.offset_x_px,
                       grid.middle_y_px + array.offset_y_px,
                       c,
                       -s,
                       s,
                       c,
                       0,
                       0,
                       array.distortion};
    return grid;
}

TEST(Array, a_turned_distorted_hexagonal_one_has_its_lenslets_where_the_grid_s_model_says) {
    const Scene scene = turned_hexagonal();
    const algo::LensletGrid grid = grid_of(scene);
    const ArrayGeometry array(scene);
    for (int n = 0; n < 33; ++n) {
        for (int m = 0; m < 31; ++m) {
            EXPECT_NEAR(array.centre_px(m, n).x, grid.centre_px(m, n).x_px, 1e-9) << m << "," << n;
            EXPECT_NEAR(array.centre_px(m, n).y, grid.centre_px(m, n).y_px, 1e-9) << m << "," << n;
        }
    }
}

// Light of a raw image within a box; each pixel's light is taken as uniform over the pixel.
double under(const CameraPicture& raw, double x0, double x1, double y0, double y1) {
    double sum = 0;
    for (int y = static_cast<int>(std::floor(y0 + 0.5)); y <= static_cast<int>(std::ceil(y1 - 0.5)); ++y) {
        for (int x = static_cast<int>(std::floor(x0 + 0.5)); x <= static_cast<int>(std::ceil(x1 - 0.5)); ++x) {
            const double wide = std::min(x1, x + 0.5) - std::max(x0, x - 0.5),
                         high = std::min(y1, y + 0.5) - std::max(y0, y - 0.5);
            if (wide > 0 && high > 0)
                sum += wide * high *
                    raw.light[static_cast<std::size_t>(y) * static_cast<std::size_t>(raw.width_px) +
                              static_cast<std::size_t>(x)];
        }
    }
    return sum;
}

TEST(Array, its_raw_frame_decodes_to_the_ideal_frame_of_the_same_scene) {
    Scene scene = turned_hexagonal();
    scene.light.source_radius_bins = 1.5;
    std::get<DoubleConvexLens>(scene.part).radius_of_curvature_mm =
        600;  // up to 1.1 bins: no light near a lenslet's border, which pixels share
    const LightField ideal = *render(scene);
    const CameraPicture raw = *lab::render_raw(scene);
    const algo::LensletGrid grid = grid_of(scene);
    const double bin = 15.4 / 9;
    double worst_light = 0, worst_slope = 0;
    for (int n = 4; n < 29; ++n) {
        for (int m = 4; m < 27; ++m) {
            const algo::PixelPoint c = grid.centre_px(m, n);
            double sum[2] = {}, u[2] = {}, v[2] = {};
            for (int k = 0; k < 63; ++k) {
                const int i = k % 9, j = k / 9;
                const double x = c.x_px + (i - 4.5) * bin, y = c.y_px + (j - 3.5) * bin;
                const double values[2] = {
                    static_cast<double>(ideal.bins[static_cast<std::size_t>((n * 7 + j) * 31 * 9 + m * 9 + i)]),
                    under(raw, x, x + bin, y, y + bin) / (bin * bin)};
                for (int f = 0; f < 2; ++f) sum[f] += values[f], u[f] += values[f] * i, v[f] += values[f] * j;
            }
            if (sum[0] < 1) continue;
            worst_light = std::max(worst_light, std::abs(sum[1] / sum[0] - 1));
            worst_slope =
                std::max(worst_slope, std::hypot(u[1] / sum[1] - u[0] / sum[0], v[1] / sum[1] - v[0] / sum[0]));
        }
    }
    EXPECT_LT(worst_light, 0.005);  // rims are sampled
    EXPECT_LT(worst_slope, 0.04);   // where the source's edge crosses a pixel (0.58 bins), its light is not uniform
}

TEST(Array, dead_lenslets_are_dark_in_both_frames) {
    Scene scene = turned_hexagonal();
    scene.part = NoPart{};
    scene.camera.array.dead = {{10, 12}};
    scene.camera.array.dead_share = 0.05;
    const LightField field = *render(scene);
    int dead = 0;
    for (int n = 0; n < 33; ++n) {
        for (int m = 0; m < 31; ++m)
            dead += field.bins[static_cast<std::size_t>((n * 7 + 3) * 31 * 9 + m * 9 + 4)] == 0;
    }
    EXPECT_EQ(field.bins[static_cast<std::size_t>((12 * 7 + 3) * 31 * 9 + 10 * 9 + 4)], 0);
    EXPECT_NEAR(dead, 0.05 * 31 * 33, 4 * std::sqrt(0.05 * 31 * 33));
    const CameraPicture raw = *lab::render_raw(scene);
    const auto at = ArrayGeometry(scene).centre_px(10, 12);
    EXPECT_EQ(raw.light[static_cast<std::size_t>(std::lround(at.y)) * static_cast<std::size_t>(raw.width_px) +
                        static_cast<std::size_t>(std::lround(at.x))],
              0);
}

TEST(Array, a_tilt_shrinks_its_pitch_and_stretches_slopes_on_its_far_side) {
    Scene scene;
    scene.camera.extents = {41, 41, 9, 9};
    scene.camera.array.pitch_um = 100, scene.camera.array.focal_um = 2000;
    scene.camera.array.tilt_y_rad = 0.1;
    const ArrayGeometry array(scene);
    EXPECT_NEAR(array.centre_px(30, 20).x - array.centre_px(20, 20).x, 90 * std::cos(0.1), 1e-9);
    EXPECT_NEAR(array.centre_px(20, 30).y - array.centre_px(20, 20).y, 90, 1e-9);
    EXPECT_NEAR(array.bin_px(40, 20), 1 + 20 * 0.1 / 2 * std::tan(0.1), 1e-9);
    EXPECT_NEAR(array.bin_px(0, 20), 1 - 20 * 0.1 / 2 * std::tan(0.1), 1e-9);
}

TEST(Array, one_that_cannot_be_is_refused) {
    const auto refusal = [](const std::string& text) {
        const auto file = std::filesystem::path(::testing::TempDir()) / "camera_refusal.toml";
        std::ofstream(file) << text;
        const auto scene = load_scene(file);
        return scene ? std::string("accepted") : scene.error().message();
    };
    EXPECT_THAT(refusal("[camera.array]\npitch_px = 3\n"),
                HasSubstr(":2: camera.array.pitch_px: makes a bin of 0.333333 pixels: a lenslet too fine for its bins: "
                          "use at least 4.5"));
    EXPECT_THAT(refusal("[camera.array]\ntilt_rad = [0.1, 0]\n"), HasSubstr("name pitch_um and focal_um"));
    EXPECT_THAT(refusal("[camera]\nm = 20\n[[camera.dead]]\nm = 20\nn = 1\n"),
                HasSubstr(":4: camera.dead[0].m: 20 is out of range: use 0 to 19"));
    EXPECT_THAT(refusal("[camera.main_lens]\nfocal_mm = 50\ndistance_mm = 40\n"),
                HasSubstr("is not beyond the focal length"));
    EXPECT_THAT(refusal("[camera.main_lens]\nfocal_mm = 50\ndistance_mm = 100\n[camera.relay]\nstop_radius_mm = 3\n"),
                HasSubstr("replaces the 4f relay"));
    EXPECT_THAT(refusal("[camera.array]\nlattice = \"round\"\n"), HasSubstr("use one of square, hexagonal"));
}

// Mean slope of the light behind a lenslet, bins.
double mean_slope(const Scene& scene, int m, int n) {
    const std::vector<double> bins = bins_of(scene, m, n);
    double sum = 0, u = 0;
    for (int k = 0; k < scene.camera.extents.bins(); ++k) {
        const double x = bins[static_cast<std::size_t>(k)];
        sum += x, u += x * (k % scene.camera.extents.i - 0.5 * (scene.camera.extents.i - 1));
    }
    return u / sum;
}

Scene one_deflection_everywhere() {
    Scene scene;
    Wedge wedge;
    wedge.half_size_mm = 20, wedge.centre_thickness_mm = 4, wedge.tilt_x_rad = 0.06;
    scene.part = wedge;
    scene.camera.extents = {41, 41, 15, 15};
    scene.light.source_radius_bins = 2;  // over many bins, their mean is that of the light
    return scene;
}

TEST(Camera, equal_deflections_make_equal_offsets_behind_every_lenslet_of_the_4f_camera) {  // the paper's Fig. 2
    const Scene scene = one_deflection_everywhere();
    const double middle = mean_slope(scene, 20, 20);
    EXPECT_NEAR(middle, std::tan(std::asin(1.5 * std::sin(0.06)) - 0.06) / 0.015, 0.01);
    for (const int m : {2, 9, 30, 38}) EXPECT_NEAR(mean_slope(scene, m, 7), middle, 1e-9) << m;
}

TEST(Camera, and_unequal_ones_in_a_conventional_plenoptic_camera) {  // Fig. 1
    Scene scene = one_deflection_everywhere();
    scene.camera.main_lens = {100, 600};  // an image at a fifth of the size
    const double middle = mean_slope(scene, 20, 20);
    for (const int m : {2, 9, 30, 38}) {
        const double x = (m - 20) * 24.0 / 41;
        EXPECT_NEAR(mean_slope(scene, m, 7) - middle, x / (600 - 100) / 0.015, 0.01) << m;
    }
    EXPECT_GT(std::abs(mean_slope(scene, 38, 20) - mean_slope(scene, 2, 20)), 2.5);
    // Far away, it becomes telecentric.
    scene.camera.main_lens = {1e3, 1e4};
    EXPECT_LT(std::abs(mean_slope(scene, 38, 20) - mean_slope(scene, 2, 20)), 0.2);
}

}  // namespace
}  // namespace hord::sim
