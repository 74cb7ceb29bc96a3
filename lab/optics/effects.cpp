#include "lab/optics/effects.h"

#include <algorithm>

namespace hord::lab {

using namespace sim;

namespace {

constexpr std::array<std::string_view, kEffects> kNames{
    "fresnel", "ghosts", "absorption",   "dispersion", "diffraction",  "stop",     "vignetting", "crosstalk",
    "dust",    "motion", "photon-noise", "read-noise", "dark-current", "pedestal", "prnu",       "full-well"};

}  // namespace

std::string_view name_of(Effect effect) { return kNames[static_cast<std::size_t>(effect)]; }

bool is_of_sensor(Effect effect) { return effect >= Effect::photon_noise; }

bool names(const Scene& scene, Effect effect) {
    const Relay& relay = scene.camera.relay;
    const SensorNoise& noise = scene.noise;
    switch (effect) {
        case Effect::fresnel: return scene.effects.fresnel;
        case Effect::ghosts: return scene.effects.ghosts;
        case Effect::absorption: return scene.glass.absorption_per_mm > 0;
        case Effect::dispersion: return is_dispersive(scene);
        case Effect::diffraction: return scene.effects.diffraction;
        case Effect::stop: return relay.stop_radius_mm > 0;
        case Effect::vignetting: return relay.lens1_radius_mm > 0 || relay.lens2_radius_mm > 0;
        case Effect::crosstalk: return scene.effects.crosstalk;
        case Effect::dust: return !scene.camera.dust.empty();
        case Effect::motion: return scene.motion.way_x_mm() != 0 || scene.motion.way_y_mm() != 0;
        case Effect::photon_noise: return noise.electrons_per_dn > 0 && noise.photon_noise;
        case Effect::read_noise: return noise.read_e > 0;
        case Effect::dark_current: return noise.dark_e_per_s > 0 || noise.dsnu_e > 0;
        case Effect::pedestal: return noise.dark_dn > 0;
        case Effect::prnu: return noise.prnu > 0;
        case Effect::full_well: return noise.full_well_e > 0;
    }
    return false;
}

std::vector<Effect> effects_of(const Scene& scene) {
    std::vector<Effect> named;
    for (std::size_t k = 0; k < kEffects; ++k) {
        if (names(scene, static_cast<Effect>(k))) named.push_back(static_cast<Effect>(k));
    }
    return named;
}

Scene without(Scene scene, Effect effect) {
    switch (effect) {
        case Effect::fresnel: scene.effects.fresnel = scene.effects.ghosts = false; break;
        case Effect::ghosts: scene.effects.ghosts = false; break;
        case Effect::absorption: scene.glass.absorption_per_mm = 0; break;
        case Effect::dispersion:
            scene.glass.abbe_number = 0;
            for (SceneDefect& defect : scene.defects) {
                if (auto* inclusion = std::get_if<Inclusion>(&defect)) inclusion->abbe_number = 0;
            }
            break;
        case Effect::diffraction: scene.effects.diffraction = false; break;
        case Effect::stop: scene.camera.relay.stop_radius_mm = 0; break;
        case Effect::vignetting: scene.camera.relay.lens1_radius_mm = scene.camera.relay.lens2_radius_mm = 0; break;
        case Effect::crosstalk: scene.effects.crosstalk = false; break;
        case Effect::dust: scene.camera.dust.clear(); break;
        case Effect::motion: scene.motion = {}; break;
        case Effect::photon_noise: scene.noise.photon_noise = false; break;
        case Effect::read_noise: scene.noise.read_e = 0; break;
        case Effect::dark_current: scene.noise.dark_e_per_s = scene.noise.dsnu_e = 0; break;
        case Effect::pedestal: scene.noise.dark_dn = 0; break;
        case Effect::prnu: scene.noise.prnu = 0; break;
        case Effect::full_well: scene.noise.full_well_e = 0; break;
    }
    return scene;
}

}  // namespace hord::lab
