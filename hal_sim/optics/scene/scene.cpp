#include "hal_sim/optics/scene/scene.h"

namespace hord::sim {

std::string_view name_of(const Part& part) {
    constexpr std::string_view names[] = {"none",          "double-convex", "wedge", "plano-convex",
                                          "cylinder-lens", "plate",         "vial",  "solid"};
    static_assert(std::size(names) == std::variant_size_v<Part>);
    return names[part.index()];
}

std::string_view name_of(const SceneDefect& defect) {
    constexpr std::string_view names[] = {"bubble", "cut", "speck", "inclusion", "scratch", "absorber", "stria"};
    static_assert(std::size(names) == std::variant_size_v<SceneDefect>);
    return names[defect.index()];
}

void derive_from_array(Camera& camera) {
    const double magnification = camera.relay.f2_mm / camera.relay.f1_mm;
    camera.field_mm = camera.extents.m * camera.array.pitch_um * 1e-3 / magnification;
    camera.bin_pitch_rad = camera.array.pitch_um / camera.extents.i / camera.array.focal_um * magnification;
}

std::vector<Collimator> collimators_of(const Scene& scene) {
    if (!scene.light.collimators.empty()) return scene.light.collimators;
    const Light& light = scene.light;
    return {{0, 0, light.source_radius_bins * scene.camera.bin_pitch_rad, light.wavelength_nm, light.bandwidth_nm, 1}};
}

}  // namespace hord::sim
