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

Scene with_typical(Scene scene, Effect effect) {
    if (names(scene, effect)) return scene;
    Camera& camera = scene.camera;
    SensorNoise& noise = scene.noise;
    const double full_scale = static_cast<double>((1 << camera.bits) - 1);
    const double range_rad = 0.5 * camera.extents.i * camera.bin_pitch_rad;
    const bool counts_electrons = noise.electrons_per_dn > 0;
    switch (effect) {
        case Effect::fresnel: scene.effects.fresnel = true; break;
        case Effect::ghosts: scene.effects.fresnel = scene.effects.ghosts = true; break;
        case Effect::absorption: scene.glass.absorption_per_mm = 0.002; break;
        case Effect::dispersion:  // crown glass in the light of an LED
            scene.glass.abbe_number = 64;
            if (scene.light.bandwidth_nm == 0) scene.light.bandwidth_nm = 30;
            for (Collimator& one : scene.light.collimators) {
                if (one.bandwidth_nm == 0) one.bandwidth_nm = 30;
            }
            break;
        case Effect::diffraction: scene.effects.diffraction = true; break;
        case Effect::stop: camera.relay.stop_radius_mm = camera.relay.f1_mm * range_rad; break;  // as far as the bins
        case Effect::vignetting:  // lenses as wide as the field's diagonal
            camera.relay.lens1_radius_mm = camera.relay.lens2_radius_mm = 0.71 * camera.field_mm;
            break;
        case Effect::crosstalk: scene.effects.crosstalk = true; break;
        case Effect::dust:  // a grain of 0.2 mm on the array, off the middle
            camera.dust = {{Dust::Plane::lenslets, camera.field_mm / 12, camera.field_mm / 16, 0.1, 0}};
            break;
        case Effect::motion: scene.motion = {500, 0, 50}; break;
        case Effect::photon_noise:
            if (!counts_electrons) noise.electrons_per_dn = 1e4 / full_scale;
            noise.photon_noise = true;
            break;
        case Effect::read_noise:
        case Effect::dark_current:
        case Effect::full_well:
            if (!counts_electrons) noise.electrons_per_dn = 1e4 / full_scale, noise.photon_noise = false;
            if (effect == Effect::read_noise) noise.read_e = 5;
            if (effect == Effect::dark_current) noise.dark_e_per_s = 20, noise.dsnu_e = 2;
            if (effect == Effect::full_well) noise.full_well_e = noise.electrons_per_dn * full_scale;
            break;
        case Effect::pedestal: noise.dark_dn = full_scale / 255; break;
        case Effect::prnu: noise.prnu = 0.01; break;
    }
    return scene;
}

}  // namespace hord::lab
