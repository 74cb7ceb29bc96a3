// Other images of a scene: of the sensor behind its lenslet array, and of a conventional telecentric camera.
#pragma once

#include <vector>

#include "hal_sim/optics/camera/render.h"

namespace hord::lab {

// An image of light, in row order.
struct CameraPicture {
    int width_px = 0, height_px = 0;
    std::vector<float> light;
};

// The picture on the scene's sensor behind its lenslet array: 1 for a pixel filled by the source. A perfect decode of
// it gives sim::render(): the light of the same lenslets, in bins centred on each.
Result<CameraPicture> render_raw(const sim::Scene& scene, const sim::RenderOptions& options = {});

// The picture of the scene's telecentric camera: 1 where all light comes from the panel.
Result<CameraPicture> render_telecentric(const sim::Scene& scene, const sim::RenderOptions& options = {});

}  // namespace hord::lab
