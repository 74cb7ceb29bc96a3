// Another image of a scene: of the sensor behind its lenslet array. (hal_sim/optics/camera/telecentric.h has the
// conventional camera's.)
#pragma once

#include "hal_sim/optics/camera/render.h"
#include "hal_sim/optics/camera/telecentric.h"

namespace hord::lab {

// The picture on the scene's sensor behind its lenslet array: 1 for a pixel filled by the source. A perfect decode of
// it gives sim::render(): the light of the same lenslets, in bins centred on each.
Result<sim::CameraPicture> render_raw(const sim::Scene& scene, const sim::RenderOptions& options = {});

}  // namespace hord::lab
