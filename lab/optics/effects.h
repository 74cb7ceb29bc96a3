// The optional physical effects of a scene.
//
// A scene names an effect by setting its parameters (docs/scene.md); other effects are not computed. Quantisation and
// saturation at the last DN are always computed. Defects are not effects.
#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "hal_sim/optics/scene/scene.h"

namespace hord::lab {

enum class Effect : std::uint8_t {
    fresnel,       // effects.fresnel; without it no ghosts either
    ghosts,        // effects.ghosts
    absorption,    // part.absorption_per_mm
    dispersion,    // part.abbe_number, an inclusion's abbe_number
    diffraction,   // effects.diffraction
    stop,          // camera.relay.stop_radius_mm
    vignetting,    // camera.relay.lens1_radius_mm, lens2_radius_mm
    crosstalk,     // effects.crosstalk
    dust,          // camera.dust
    motion,        // motion
    photon_noise,  // noise.electrons_per_dn; without it the other noise is as it was
    read_noise,    // noise.read_e
    dark_current,  // noise.dark_e_per_s, dsnu_e
    pedestal,      // noise.dark_dn
    prnu,          // noise.prnu
    full_well,     // noise.full_well_e
};
inline constexpr std::size_t kEffects = 16;

[[nodiscard]] std::string_view name_of(Effect effect);
[[nodiscard]] bool is_of_sensor(Effect effect);  // changes the exposure, not the light
[[nodiscard]] bool names(const sim::Scene& scene, Effect effect);
[[nodiscard]] std::vector<Effect> effects_of(const sim::Scene& scene);  // those that the scene names
[[nodiscard]] sim::Scene without(sim::Scene scene, Effect effect);      // names(without(scene, e), e) is false

// The scene with this effect at a value that is usual in inspection cells (effects.cpp), if it does not name it.
[[nodiscard]] sim::Scene with_typical(sim::Scene scene, Effect effect);

}  // namespace hord::lab
