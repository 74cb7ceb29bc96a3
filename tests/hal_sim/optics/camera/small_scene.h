// Scenes with few lenslets, and the HORD of one lenslet.
#pragma once

#include <cmath>
#include <vector>

#include "hal_sim/optics/camera/lenslet_light.h"
#include "hal_sim/optics/camera/render.h"

namespace hord::sim {

constexpr double kPi = 3.14159265358979323846;
constexpr double kSource = kPi * 0.61 * 0.61;  // light of an unobstructed lenslet, bins

inline Scene small(const Part& part, int lenslets) {
    Scene scene;
    scene.part = part;
    scene.camera.extents = {lenslets, lenslets, 9, 9};
    return scene;
}
inline Scene wedge(double bins) {  // bends the light to the right
    Wedge part;
    part.centre_thickness_mm = 8;
    part.tilt_x_rad = std::atan2(std::tan(bins * 0.015), 0.5) * 0.98;
    return small(part, 9);
}

// The light in the bins of lenslet (m, n): [j * extents.i + i].
inline std::vector<double> bins_of(const Scene& scene, int m, int n) {
    std::vector<double> bins(static_cast<std::size_t>(scene.camera.extents.bins()));
    const SlopeGrid grid = SlopeGrid::of(scene.camera.extents);
    LensletLight(scene).collect(CameraGeometry(scene).place_of(m, n), grid, grid.box(), bins.data());
    return bins;
}

struct Hord {
    double sum = 0, u = 0, v = 0;  // light in bins; mean slope, bins
};
inline Hord hord(const LightField& field, int m, int n) {
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
inline Hord hord(const Scene& scene, int m, int n) {
    const std::vector<double> bins = bins_of(scene, m, n);
    LightField one{{1, 1, scene.camera.extents.i, scene.camera.extents.j}, {bins.begin(), bins.end()}};
    return hord(one, 0, 0);
}

}  // namespace hord::sim
