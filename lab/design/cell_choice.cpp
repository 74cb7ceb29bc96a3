#include "lab/design/cell_choice.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace hord::lab {
namespace {

constexpr double kFullShare = 0.94;  // of the full scale, a bin filled by the source: as 240 of 255
constexpr int kMaxLenslets = 2047, kMinLenslets = 31;
// First zero of the diffraction at a lenslet, in bins, above which bins are finer than the light can be.
constexpr double kMaxDiffraction = 1;

double pitch_mm(const CellChoice& cell, const sim::Scene& part, const CameraLimits& camera) {
    return part.camera.field_mm / lenslets_of(cell, camera);
}
double wavelength_mm(const sim::Scene& part) {
    double longest = 0;
    for (const sim::Collimator& light : sim::collimators_of(part)) longest = std::max(longest, light.wavelength_nm);
    return longest * 1e-6;
}

}  // namespace

int lenslets_of(const CellChoice& cell, const CameraLimits& camera) {
    const int most = static_cast<int>(std::sqrt(camera.pixels) * cell.pixels_share + 1e-9) / cell.bins;
    return std::min((most - 1) / 2 * 2 + 1, kMaxLenslets);
}

CellOptics optics_of(const CellChoice& cell, const sim::Scene& part, const CameraLimits& camera) {
    CellOptics optics;
    optics.lenslet_um = cell.bins * camera.pixel_um;
    optics.magnification = lenslets_of(cell, camera) * optics.lenslet_um * 1e-3 / part.camera.field_mm;
    optics.focal_um = camera.pixel_um / cell.bin_pitch_rad * optics.magnification;
    return optics;
}

std::string describe(const CellChoice& cell, const sim::Scene& part, const CameraLimits& camera) {
    const int lenslets = lenslets_of(cell, camera);
    return fmt::format(
        "{0}x{0} bins of {1:.3g} mrad, {2}x{2} lenslets of {3:.3g} mm, source radius {4:.3g} bin, light {5:g}",
        cell.bins, 1e3 * cell.bin_pitch_rad, lenslets, pitch_mm(cell, part, camera), cell.source_radius_bins,
        cell.light);
}

std::string problem_of(const CellChoice& cell, const sim::Scene& part, const CameraLimits& camera,
                       double largest_slope) {
    if (lenslets_of(cell, camera) < kMinLenslets) return fmt::format("fewer than {} lenslets a side", kMinLenslets);
    if (cell.bin_pitch_rad > 0.2) return "bins above 200 mrad";
    const double half = 0.5 * cell.bins, needed = largest_slope / cell.bin_pitch_rad + cell.source_radius_bins;
    if (needed > half) return "the clean part's light leaves the bins";
    const double blur = wavelength_mm(part) / pitch_mm(cell, part, camera) / cell.bin_pitch_rad;
    if (blur > kMaxDiffraction) return "diffraction at a lenslet is wider than a bin";
    if (optics_of(cell, part, camera).f_number() < camera.fastest_lenslet)
        return fmt::format("the lenslets would be faster than f/{:g}", camera.fastest_lenslet);
    return {};
}

sim::Scene scene_of(const CellChoice& cell, const sim::Scene& part, const CameraLimits& camera) {
    sim::Scene scene = part;
    const int lenslets = lenslets_of(cell, camera);
    sim::Camera& to = scene.camera;
    const double field = to.field_mm;
    to = sim::Camera{};
    to.extents = {lenslets, lenslets, cell.bins, cell.bins};
    to.field_mm = field;
    to.bin_pitch_rad = cell.bin_pitch_rad;
    to.bits = camera.bits;
    const double full_scale = static_cast<double>((1 << camera.bits) - 1);
    to.full_bin_dn = kFullShare * full_scale * cell.light;
    scene.motion = {};
    scene.light.collimators.clear();
    scene.light.source_radius_bins = cell.source_radius_bins;
    scene.effects.diffraction = camera.diffraction;
    scene.effects.crosstalk = false;
    scene.noise = {};
    scene.noise.electrons_per_dn = camera.full_well_e / full_scale;
    scene.noise.read_e = camera.read_e;
    scene.noise.full_well_e = camera.full_well_e;
    scene.noise.dark_dn = full_scale / 255;
    scene.defects.clear();
    return scene;
}

sim::Scene window_of(const sim::Scene& scene, int m, int n, int lenslets) {
    sim::Scene window = scene;
    const algo::Extents& e = scene.camera.extents;
    const double pitch = scene.camera.field_mm / e.m;
    window.camera.extents.m = window.camera.extents.n = lenslets;
    window.camera.field_mm = pitch * lenslets;
    window.pose.x_mm -= (m - 0.5 * (e.m - 1)) * pitch;
    window.pose.y_mm -= (n - 0.5 * (e.n - 1)) * pitch;
    return window;
}

}  // namespace hord::lab
