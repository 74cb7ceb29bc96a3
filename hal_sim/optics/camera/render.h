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

// The true positions of the defects, in lenslets.
struct TruthDefect {
    double m = 0, n = 0;  // centre
    double radius_lenslets = 0;
    std::uint32_t area_lenslets = 0;  // lenslets touched by it
    const char* kind = "";            // as in the scene file: bubble, cut, speck, ...
};
struct Truth {
    bool defect_free = true;
    std::vector<TruthDefect> defects;
    // One value a lenslet: 0 free field, 1 part, 2 the part's border, 3 defect, 4 defect inside the border.
    std::vector<std::uint8_t> labels;
};

struct RenderOptions {
    int threads = 0;                            // 0: one a core; the result does not depend on it
    std::function<void(double done)> progress;  // 0..1, from the calling thread; may be empty
};

Result<LightField> render(const Scene& scene, const RenderOptions& options = {});

// A picture of light, row by row.
struct Picture {
    int width_px = 0, height_px = 0;
    std::vector<float> light;
};

// The picture on the scene's sensor behind its lenslet array: 1 for a pixel filled by the source. A perfect decode of
// it gives render(): the light of the same lenslets, in bins centred on each.
Result<Picture> render_raw(const Scene& scene, const RenderOptions& options = {});

// The picture of the scene's telecentric camera: 1 where all light comes from the panel.
Result<Picture> render_telecentric(const Scene& scene, const RenderOptions& options = {});

Truth truth_of(const Scene& scene);

// One exposure of a light field: scale, noise, quantise, saturate. `light` scales the source (1: nominal, 0: dark).
// The same seed gives the same bits on every machine.
Frame expose(const LightField& field, const Scene& scene, std::uint64_t seed, double light = 1.0);

// The same of any picture of light, row by row, 1 for a pixel filled by the source.
Frame expose(std::span<const float> light, int width_px, int height_px, const Scene& scene, std::uint64_t seed,
             double strength = 1.0);

}  // namespace hord::sim
