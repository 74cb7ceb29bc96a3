#include "hal_sim/cell/production.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "hal_sim/optics/scene/geometry.h"
#include "hal_sim/world/random.h"

namespace hord::sim {
namespace {

// Sizes of the defects that do not take light away, as [smallest, largest]; all of the camera's face towards the
// source. Where they come from, and their ISO 10110 terms: docs/notes/optics.md.
constexpr double kDimpleRimMm[] = {0.8, 1.0}, kDimpleRad[] = {0.0105, 0.0115};
constexpr double kStriaHalfMm[] = {0.6, 1.2}, kStriaRadiusMm[] = {0.35, 0.42}, kStriaRad[] = {0.0058, 0.0064};
constexpr double kStriaTurn = 0.2;  // rad, at most, from the direction in which the glass was drawn, y
constexpr double kInclusionRadiusMm[] = {0.45, 0.6}, kInclusionRadPerMm[] = {0.0195, 0.0215};
constexpr double kHazeRadiusMm[] = {0.7, 1.0}, kHazeRad[] = {0.015, 0.0158};
constexpr double kScratchHalfMm[] = {0.6, 1.2}, kScratchRadiusMm[] = {0.042, 0.05};
constexpr double kScratchTurn[] = {0.2, 1.3};  // rad, from y
constexpr double kSkinMm = 0.1;                // of flawless glass over a stria or an inclusion
constexpr double kSharpBelowMm = 0.25;         // depth in the glass of line_lens() that its camera sees sharply
constexpr double kDeflectorsWithin = 0.5;      // of the aperture

// Uniform draws, one after the other.
class Draws {
  public:
    explicit Draws(std::uint64_t seed) : seed_(seed) {}
    double between(double low, double high) { return low + (high - low) * random_unit(seed_, kStream, drawn_++); }

  private:
    static constexpr std::uint64_t kStream = 0x9A57;
    std::uint64_t seed_, drawn_ = 0;
};

// Camera-side surface of the lens at (x, y), in the part's frame.
double surface_z(const DoubleConvexLens& lens, double x, double y) {
    const double radius = lens.radius_of_curvature_mm;
    const double at_edge = std::sqrt(radius * radius - lens.aperture_radius_mm * lens.aperture_radius_mm);
    return lens.edge_thickness_mm / 2 + std::sqrt(radius * radius - x * x - y * y) - at_edge;
}

Vec3 place_inside(Draws& draws, double within_mm) {
    const double radius = within_mm * std::sqrt(draws.between(0, 1));
    const double angle = draws.between(0, 2 * std::numbers::pi);
    return {radius * std::cos(angle), radius * std::sin(angle), 0};
}

// A place on the face towards the source, and the direction out of the part there.
struct OnFace {
    Vec3 at, out;
};
OnFace on_source_side(const DoubleConvexLens& lens, double x, double y) {
    const Vec3 at{x, y, -surface_z(lens, x, y)};
    return {at, unit(at - Vec3{0, 0, lens.radius_of_curvature_mm - surface_z(lens, 0, 0)})};
}

Dimple draw_dimple(const Vec3& at, const DoubleConvexLens& lens, Draws& draws) {
    const double rim_mm = draws.between(kDimpleRimMm[0], kDimpleRimMm[1]);
    const double deflection_rad = draws.between(kDimpleRad[0], kDimpleRad[1]);
    // At its rim the face changes its slope by rim (1 / radius + 1 / radius of the lens).
    const double bend = deflection_rad / (lens.refractive_index - 1) / rim_mm;
    const double radius = 1 / (bend - 1 / lens.radius_of_curvature_mm);
    const double depth = rim_mm * rim_mm * bend / 2;
    const OnFace face = on_source_side(lens, at.x, at.y);
    return {face.at + (radius - depth) * face.out, radius};
}

// The two halves deflect to opposite sides: the mean deflection of neighbours jumps in the middle.
Stria draw_stria(const Vec3& at, const DoubleConvexLens& lens, Draws& draws) {
    const double half_mm = draws.between(kStriaHalfMm[0], kStriaHalfMm[1]);
    const double turn = draws.between(-kStriaTurn, kStriaTurn);
    const double radius = draws.between(kStriaRadiusMm[0], kStriaRadiusMm[1]);
    const Vec3 along{half_mm * std::sin(turn), half_mm * std::cos(turn), 0};
    const Vec3 middle{at.x, at.y, kSkinMm + radius - surface_z(lens, at.x, at.y)};
    return {middle - along, middle + along, radius, draws.between(kStriaRad[0], kStriaRad[1]) / 2, true};
}

Inclusion draw_inclusion(const Vec3& at, const DoubleConvexLens& lens, Draws& draws) {
    const double radius = draws.between(kInclusionRadiusMm[0], kInclusionRadiusMm[1]);
    const double rim_rad = radius * draws.between(kInclusionRadPerMm[0], kInclusionRadPerMm[1]);
    const double z = kSkinMm + radius / 4 - surface_z(lens, at.x, at.y);
    return {{at.x, at.y, z}, radius, lens.refractive_index + rim_rad / Inclusion::kSoftRim, 0, true};
}

Haze draw_haze(const Vec3& at, const DoubleConvexLens& lens, Draws& draws) {
    const double radius = draws.between(kHazeRadiusMm[0], kHazeRadiusMm[1]);
    return {{at.x, at.y, -surface_z(lens, at.x, at.y)}, radius, draws.between(kHazeRad[0], kHazeRad[1])};
}

// Its axis touches the face: half of the groove is in the glass.
Scratch draw_scratch(const Vec3& at, const DoubleConvexLens& lens, Draws& draws) {
    const double half_mm = draws.between(kScratchHalfMm[0], kScratchHalfMm[1]);
    const double turn = draws.between(kScratchTurn[0], kScratchTurn[1]);
    const OnFace face = on_source_side(lens, at.x, at.y);
    const Vec3 across{std::cos(turn), -std::sin(turn), 0}, along = half_mm * unit(cross(face.out, across));
    return {face.at - along, face.at + along, draws.between(kScratchRadiusMm[0], kScratchRadiusMm[1])};
}

SceneDefect draw_defect(PartClass made_as, const DoubleConvexLens& lens, Draws& draws) {
    // Away from the rim, where the rim mask hides defects (docs/architecture.md).
    const bool newer = made_as > PartClass::speck;
    const Vec3 at = place_inside(draws, (newer ? kDeflectorsWithin : 0.65) * lens.aperture_radius_mm);
    switch (made_as) {
        case PartClass::bubble: return AirBubble{{at.x, at.y, draws.between(-0.5, 0.5)}, draws.between(0.3, 0.6)};
        case PartClass::cut: {
            const double radius = draws.between(0.8, 1.6);
            return SphericalCut{{at.x, at.y, surface_z(lens, at.x, at.y) + radius / 3}, radius};
        }
        case PartClass::dimple: return draw_dimple(at, lens, draws);
        case PartClass::stria: return draw_stria(at, lens, draws);
        case PartClass::inclusion: return draw_inclusion(at, lens, draws);
        case PartClass::haze: return draw_haze(at, lens, draws);
        case PartClass::scratch: return draw_scratch(at, lens, draws);
        case PartClass::speck:
        case PartClass::good: break;
    }
    return AbsorbingSpeck{at, draws.between(0.35, 0.7), draws.between(0, 0.25)};
}

}  // namespace

Scene line_lens(int bins_i, int bins_j) {
    Scene scene;
    scene.name = "lens";
    const DoubleConvexLens lens;
    scene.part = lens;
    // Seen through the face at height h, the measurement plane lies n times as deep below it.
    const double h = surface_z(lens, 0, 0), n = lens.refractive_index;
    scene.pose.z_mm = (2 * h - kSharpBelowMm) / n - h;
    scene.camera.extents = {111, 111, bins_i, bins_j};
    scene.noise.electrons_per_dn = 40;
    scene.noise.read_e = 2;
    scene.noise.dark_dn = 1;
    return scene;
}

Result<Production> draw_production(const ProductionOptions& options) {
    const auto* lens = std::get_if<DoubleConvexLens>(&options.clean.part);
    if (lens == nullptr) {
        return fail(ErrorCode::unsupported,
                    "production of scene " + options.clean.name + ": its part is not a double-convex lens",
                    "use a scene with a double-convex lens, such as hal_sim/scenes/lens.toml");
    }
    Production production;
    Draws draws(options.seed);
    const auto add = [&](PartClass made_as, int count, double share) {
        for (int k = 0; k < count; ++k) {
            Scene scene = options.clean;
            scene.name = std::string(name_of(made_as)) + "-" + std::to_string(k + 1);
            scene.pose.x_mm = draws.between(-options.wobble_mm, options.wobble_mm);
            scene.pose.y_mm = draws.between(-options.wobble_mm, options.wobble_mm);
            if (made_as != PartClass::good) scene.defects = {draw_defect(made_as, *lens, draws)};
            production.scenes.push_back(std::move(scene));
            production.kinds.push_back({std::string(name_of(made_as)), made_as != PartClass::good, share});
        }
    };
    add(PartClass::good, options.good_parts, options.good_share / options.good_parts);
    const auto defective = static_cast<double>(options.of_each_defect) * static_cast<double>(options.defects.size());
    for (const PartClass made_as : options.defects)
        add(made_as, options.of_each_defect, (1 - options.good_share) / defective);
    return production;
}

}  // namespace hord::sim
