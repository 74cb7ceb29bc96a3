#include "hal_sim/cell/production.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "hal_sim/optics/scene/geometry.h"
#include "hal_sim/world/random.h"

namespace hord::sim {
namespace {

// Sizes of the defects that only deflect light, as [smallest, largest]: docs/notes/optics.md.
constexpr double kDimpleRimMm[] = {0.8, 1.0}, kDimpleRad[] = {0.011, 0.012};
constexpr double kStriaHalfMm[] = {0.6, 1.2}, kStriaRadiusMm[] = {0.095, 0.108}, kStriaIndex[] = {0.0112, 0.012};
constexpr double kStriaTurn = 0.2;  // rad, at most, from the direction in which the glass was drawn, y
constexpr double kInclusionRadiusMm[] = {0.35, 0.45}, kInclusionIndex[] = {0.0026, 0.003};
constexpr double kNearSharpMm = 0.1;       // depths within this of the sharp plane
constexpr double kDeflectorsWithin = 0.5;  // of the aperture

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

// Depth in the glass that the camera sees sharply: the measurement plane, seen through the camera-side face.
double sharp_z(const DoubleConvexLens& lens) { return (1 - lens.refractive_index) * surface_z(lens, 0, 0); }

// A place on the face towards the source, and the direction out of the part there.
struct OnFace {
    Vec3 at, out;
};
OnFace on_source_side(const DoubleConvexLens& lens, double x, double y) {
    const Vec3 at{x, y, -surface_z(lens, x, y)};
    return {at, unit(at - Vec3{0, 0, lens.radius_of_curvature_mm - surface_z(lens, 0, 0)})};
}

// A shallow spherical hollow.
SphericalCut draw_dimple(const Vec3& at, const DoubleConvexLens& lens, Draws& draws) {
    const double rim_mm = draws.between(kDimpleRimMm[0], kDimpleRimMm[1]);
    const double deflection_rad = draws.between(kDimpleRad[0], kDimpleRad[1]);
    // At its rim the face changes its slope by rim (1 / radius + 1 / radius of the lens).
    const double bend = deflection_rad / (lens.refractive_index - 1) / rim_mm;
    const double radius = 1 / (bend - 1 / lens.radius_of_curvature_mm);
    const double depth = rim_mm * rim_mm * bend / 2;
    const OnFace face = on_source_side(lens, at.x, at.y);
    return {face.at + (radius - depth) * face.out, radius};
}

// As wide as a lenslet: each deflects its light to both sides alike, and its mean deflection stays.
Stria draw_stria(const Vec3& at, const DoubleConvexLens& lens, Draws& draws) {
    const double half_mm = draws.between(kStriaHalfMm[0], kStriaHalfMm[1]);
    const double turn = draws.between(-kStriaTurn, kStriaTurn);
    const double z = sharp_z(lens) + draws.between(-kNearSharpMm, kNearSharpMm);
    const Vec3 along{half_mm * std::sin(turn), half_mm * std::cos(turn), 0}, middle{at.x, at.y, z};
    const double radius = draws.between(kStriaRadiusMm[0], kStriaRadiusMm[1]);
    return {middle - along, middle + along, radius, draws.between(kStriaIndex[0], kStriaIndex[1]), true};
}

Inclusion draw_inclusion(const Vec3& at, const DoubleConvexLens& lens, Draws& draws) {
    const double z = sharp_z(lens) + draws.between(-kNearSharpMm, kNearSharpMm);
    const double radius = draws.between(kInclusionRadiusMm[0], kInclusionRadiusMm[1]);
    return {{at.x, at.y, z}, radius, lens.refractive_index + draws.between(kInclusionIndex[0], kInclusionIndex[1]), 0};
}

SceneDefect draw_defect(PartClass made_as, const DoubleConvexLens& lens, Draws& draws) {
    // Away from the rim, where the rim mask hides defects (docs/architecture.md).
    const bool deflects = std::ranges::find(kDeflectors, made_as) != kDeflectors.end();
    const Vec3 at = place_inside(draws, (deflects ? kDeflectorsWithin : 0.65) * lens.aperture_radius_mm);
    switch (made_as) {
        case PartClass::bubble: return AirBubble{{at.x, at.y, draws.between(-0.5, 0.5)}, draws.between(0.3, 0.6)};
        case PartClass::cut: {
            const double radius = draws.between(0.8, 1.6);
            return SphericalCut{{at.x, at.y, surface_z(lens, at.x, at.y) + radius / 3}, radius};
        }
        case PartClass::dimple: return draw_dimple(at, lens, draws);
        case PartClass::stria: return draw_stria(at, lens, draws);
        case PartClass::inclusion: return draw_inclusion(at, lens, draws);
        case PartClass::speck:
        case PartClass::good: break;
    }
    return AbsorbingSpeck{at, draws.between(0.35, 0.7), draws.between(0, 0.25)};
}

}  // namespace

Scene line_lens(int bins_i, int bins_j) {
    Scene scene;
    scene.name = "lens";
    scene.part = DoubleConvexLens{};
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
