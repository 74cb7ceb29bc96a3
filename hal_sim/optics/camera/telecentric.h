// What an ordinary inspection camera sees of a scene, for comparison: telecentric, before a panel of light.
#pragma once

#include <vector>

#include "hal_sim/optics/camera/render.h"

namespace hord::sim {

// An image of light, in row order.
struct CameraPicture {
    int width_px = 0, height_px = 0;
    std::vector<float> light;
};

// The picture of the scene's telecentric camera, without noise: 1 where all light comes from the panel.
Result<CameraPicture> render_telecentric(const Scene& scene, const RenderOptions& options = {});

}  // namespace hord::sim
