// The scenes that the experiments share.
#pragma once

#include "hal_sim/optics/scene/scene.h"

namespace hord::lab {

// The lens of the paper's Fig. 5 as hal_sim/scenes/lens.toml has it (double-convex, R 190 mm, aperture radius 10 mm,
// index 1.5; 24 mm field, 9x9 bins of 15 mrad, source of 0.61 bin radius, 8 bit, no noise), seen by `lenslets` squared
// lenslets.
sim::Scene lens_scene(int lenslets);
// Its defects. The cut: a sphere `depth_mm` deep in the face towards the camera, in the upper left quarter.
sim::SphericalCut cut_of_lens(double depth_mm, double radius_mm = 1.5);
sim::AirBubble bubble_of_lens(double radius_mm);
sim::AbsorbingSpeck absorber_of_lens(double transmission);

// A close-up of the scene for both cameras: a square of `lenslets` about the point (x, y) of the part, at the same
// pitch.
sim::Scene close_up(const sim::Scene& scene, double x_mm, double y_mm, int lenslets);

}  // namespace hord::lab
