// Traces a scene backwards through the 4f camera into a light field, in double precision, independent of algo/.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "common/frame.h"
#include "hal_sim/optics/scene/scene.h"

namespace hord::sim {

// Noise-free light, in units of a bin filled by the source; value(m,n,i,j) at macro-pixel column m*I+i, row n*J+j.
struct LightField {
    algo::Extents extents;
    std::vector<float> bins;
};

struct RenderOptions {
    int threads = 0;                            // 0: one a core; the result does not depend on it
    std::function<void(double done)> progress;  // 0..1, from the calling thread; may be empty
};

Result<LightField> render(const Scene& scene, const RenderOptions& options = {});

// One exposure of a light field: scale, noise, quantise, saturate. `light` scales the source (1: nominal, 0: dark).
// The same seed gives the same bits on every machine.
Frame expose(const LightField& field, const Scene& scene, std::uint64_t seed, double light = 1.0);

// The same for any image of light, in row order; 1 is a pixel filled by the source.
Frame expose(std::span<const float> light, int width_px, int height_px, const Scene& scene, std::uint64_t seed,
             double strength = 1.0);

}  // namespace hord::sim
