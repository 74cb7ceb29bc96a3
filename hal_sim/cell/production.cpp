#include "hal_sim/cell/production.h"

#include <cmath>
#include <numbers>
#include <string>

#include "hal_sim/world/random.h"

namespace hord::sim {
namespace {

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

SceneDefect draw_defect(PartClass made_as, const DoubleConvexLens& lens, Draws& draws) {
    // Away from the rim, where the rim mask hides defects (docs/architecture.md).
    const Vec3 at = place_inside(draws, 0.65 * lens.aperture_radius_mm);
    switch (made_as) {
        case PartClass::bubble: return AirBubble{{at.x, at.y, draws.between(-0.5, 0.5)}, draws.between(0.3, 0.6)};
        case PartClass::cut: {
            const double radius = draws.between(0.8, 1.6);
            return SphericalCut{{at.x, at.y, surface_z(lens, at.x, at.y) + radius / 3}, radius};
        }
        case PartClass::speck:
        case PartClass::good: break;
    }
    return AbsorbingSpeck{at, draws.between(0.35, 0.7), draws.between(0, 0.25)};
}

}  // namespace

Result<Production> draw_production(const ProductionOptions& options) {
    const auto* lens = std::get_if<DoubleConvexLens>(&options.clean.part);
    if (lens == nullptr) {
        return fail(ErrorCode::unsupported,
                    "production of scene " + options.clean.name + ": its part is not a double-convex lens",
                    "use a scene with a double-convex lens, such as hal_sim/scenes/lens.toml");
    }
    Production production;
    Draws draws(options.seed);
    for (std::size_t number = 0; number < kPartClassNames.size(); ++number) {
        const auto made_as = static_cast<PartClass>(number);
        const bool good = made_as == PartClass::good;
        const int count = good ? options.good_parts : options.of_each_defect;
        const auto defective =
            static_cast<double>(options.of_each_defect) * static_cast<double>(kPartClassNames.size() - 1);
        for (int k = 0; k < count; ++k) {
            Scene scene = options.clean;
            scene.name = std::string(kPartClassNames[number]) + "-" + std::to_string(k + 1);
            scene.pose.x_mm = draws.between(-options.wobble_mm, options.wobble_mm);
            scene.pose.y_mm = draws.between(-options.wobble_mm, options.wobble_mm);
            if (!good) scene.defects.push_back(draw_defect(made_as, *lens, draws));
            production.scenes.push_back(std::move(scene));
            production.kinds.push_back(
                {std::string(kPartClassNames[number]), !good,
                 good ? options.good_share / options.good_parts : (1 - options.good_share) / defective});
        }
    }
    return production;
}

}  // namespace hord::sim
