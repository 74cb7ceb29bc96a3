// From light to the sensor's samples: the linear sensor of EMVA Standard 1288, release 4.0, section 2.
#include <algorithm>
#include <cmath>
#include <optional>

#include "hal_sim/optics/camera/render.h"
#include "hal_sim/optics/scene/noise.h"

namespace hord::sim {
namespace {

enum Purpose : std::uint32_t { kTemporal = 0, kGains = 1, kOffsets = 2 };

// DN before rounding, of a pixel that light would fill to `dn`.
class Sensor {
  public:
    Sensor(const SensorNoise& noise, std::uint64_t seed)
        : noise_(noise), seed_(seed), dark_e_(noise.dark_e_per_s * noise.exposure_ms * 1e-3) {}

    [[nodiscard]] double read(double dn, std::uint64_t pixel) const {
        if (noise_.prnu > 0) dn *= std::max(0.0, 1 + noise_.prnu * Noise(noise_.pattern_seed, pixel, kGains).normal());
        if (noise_.electrons_per_dn > 0) {
            Noise draw(seed_, pixel, kTemporal);
            const double mean = dn * noise_.electrons_per_dn + dark_e_;
            double electrons = noise_.photon_noise ? static_cast<double>(draw.poisson(mean)) : mean;
            if (noise_.dsnu_e > 0) electrons += noise_.dsnu_e * Noise(noise_.pattern_seed, pixel, kOffsets).normal();
            if (noise_.full_well_e > 0) electrons = std::min(electrons, noise_.full_well_e);
            if (noise_.read_e > 0) electrons += noise_.read_e * draw.normal();
            dn = electrons / noise_.electrons_per_dn;
        }
        return dn + noise_.dark_dn;
    }

    // The sample that every pixel without light has, whatever is drawn; none if noise may change it.
    [[nodiscard]] std::optional<std::uint32_t> without_light(double top) const {
        double noise_dn = 0;
        if (noise_.electrons_per_dn > 0) {
            if (dark_e_ > 0) return {};
            noise_dn = Noise::kLargestNormal * (noise_.dsnu_e + noise_.read_e) / noise_.electrons_per_dn;
        }
        const std::uint32_t least = sample(noise_.dark_dn - noise_dn, top),
                            most = sample(noise_.dark_dn + noise_dn, top);
        return least == most ? std::optional(least) : std::nullopt;
    }

    static std::uint32_t sample(double dn, double top) {
        return static_cast<std::uint32_t>(std::clamp(std::floor(dn + 0.5), 0.0, top));
    }

  private:
    const SensorNoise& noise_;
    std::uint64_t seed_;
    double dark_e_;
};

}  // namespace

Frame expose(std::span<const float> light, int width_px, int height_px, const Scene& scene, std::uint64_t seed,
             double strength) {
    Frame frame(width_px, height_px, scene.camera.bits);
    const double top = frame.view().full_scale(), full = scene.camera.full_bin_dn * strength;
    const Sensor sensor(scene.noise, seed);
    const auto unlit = sensor.without_light(top);
    std::size_t at = 0;
    for (int y = 0; y < height_px; ++y) {
        for (int x = 0; x < width_px; ++x, ++at) {
            frame.set(x, y,
                      unlit && light[at] == 0
                          ? *unlit
                          : Sensor::sample(sensor.read(full * static_cast<double>(light[at]), at), top));
        }
    }
    return frame;
}

Frame expose(const LightField& field, const Scene& scene, std::uint64_t seed, double light) {
    return expose(field.bins, field.extents.width_px(), field.extents.height_px(), scene, seed, light);
}

}  // namespace hord::sim
