// From light to the sensor's samples.
#include <algorithm>
#include <cmath>

#include "hal_sim/optics/noise.h"
#include "hal_sim/optics/render.h"

namespace hord::sim {

algo::Frame expose(const LightField& field, const Scene& scene, std::uint64_t seed, double light) {
    const int width = field.extents.width_px(), height = field.extents.height_px();
    algo::Frame frame(width, height, scene.camera.bits);
    const double top = frame.view().full_scale();
    const SensorNoise& noise = scene.noise;
    const double full = scene.camera.full_bin_dn * light;
    const bool noisy = noise.electrons_per_dn > 0;
    std::size_t at = 0;
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x, ++at) {
            double dn = full * static_cast<double>(field.bins[at]);
            if (noisy) {
                Noise draw(seed, at);
                double electrons = static_cast<double>(draw.poisson(dn * noise.electrons_per_dn));
                if (noise.read_e > 0) electrons += noise.read_e * draw.normal();
                dn = electrons / noise.electrons_per_dn;
            }
            dn = std::floor(dn + noise.dark_dn + 0.5);
            frame.set(x, y, static_cast<std::uint32_t>(std::clamp(dn, 0.0, top)));
        }
    }
    return frame;
}

}  // namespace hord::sim
