#include "hal_sim/optics/scene/scene.h"

#include <algorithm>

namespace hord::sim {

std::string_view name_of(const Part& part) {
    constexpr std::string_view names[] = {"none",          "double-convex", "wedge", "plano-convex",
                                          "cylinder-lens", "plate",         "vial",  "solid"};
    static_assert(std::size(names) == std::variant_size_v<Part>);
    return names[part.index()];
}

std::string_view name_of(const SceneDefect& defect) {
    constexpr std::string_view names[] = {"bubble",   "cut",   "speck", "inclusion", "scratch",
                                          "absorber", "stria", "haze",  "dimple"};
    static_assert(std::size(names) == std::variant_size_v<SceneDefect>);
    return names[defect.index()];
}

std::vector<Collimator> collimators_of(const Scene& scene) {
    if (!scene.light.collimators.empty()) return scene.light.collimators;
    const Light& light = scene.light;
    return {{0, 0, light.source_radius_bins * scene.camera.bin_pitch_rad, light.wavelength_nm, light.bandwidth_nm, 1}};
}

bool is_dispersive(const Scene& scene) {
    return (scene.glass.abbe_number > 0 && !std::holds_alternative<NoPart>(scene.part)) ||
        std::any_of(scene.defects.begin(), scene.defects.end(), [](const SceneDefect& defect) {
               const auto* inclusion = std::get_if<Inclusion>(&defect);
               return inclusion != nullptr && inclusion->abbe_number > 0;
           });
}

}  // namespace hord::sim
