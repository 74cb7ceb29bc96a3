#include "lab/experiment/scenes.h"

#include <cmath>

namespace hord::lab {

namespace {

constexpr double kCutAt = -4.5;  // x and y, mm: the upper left quarter
constexpr sim::Vec3 kAbsorberAt{3, 4, 0};

}  // namespace

sim::Scene lens_scene(int lenslets) {
    sim::Scene scene;
    scene.name = "lens";
    scene.part = sim::DoubleConvexLens{};
    scene.camera.extents = {lenslets, lenslets, 9, 9};
    scene.telecentric.width_px = scene.telecentric.height_px = lenslets;
    return scene;
}

sim::SphericalCut cut_of_lens(double depth_mm, double radius_mm) {
    const sim::DoubleConvexLens lens;
    const double r = lens.radius_of_curvature_mm, a = lens.aperture_radius_mm;
    const double surface =
        lens.edge_thickness_mm / 2 + std::sqrt(r * r - 2 * kCutAt * kCutAt) - std::sqrt(r * r - a * a);
    return {{kCutAt, kCutAt, surface + radius_mm - depth_mm}, radius_mm};
}

sim::AirBubble bubble_of_lens(double radius_mm) { return {{0, 0, 0}, radius_mm}; }
sim::AbsorbingSpeck absorber_of_lens(double transmission) { return {kAbsorberAt, 0.4, transmission}; }

sim::Scene close_up(const sim::Scene& scene, double x_mm, double y_mm, int lenslets) {
    sim::Scene near = scene;
    near.camera.field_mm = scene.camera.field_mm * lenslets / scene.camera.extents.m;
    near.camera.extents.m = near.camera.extents.n = lenslets;
    near.telecentric.field_mm = near.camera.field_mm;
    near.telecentric.width_px = near.telecentric.height_px = lenslets;
    near.pose.x_mm -= x_mm;
    near.pose.y_mm -= y_mm;
    return near;
}

}  // namespace hord::lab
