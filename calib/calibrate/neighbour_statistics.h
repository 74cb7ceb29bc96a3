// How lenslets differ from their neighbours, in light and in place. Used by calib/calibrate only.
#pragma once

#include <span>
#include <vector>

#include "algo/frame/lenslet_grid.h"
#include "calib/calibrate/calibrate_grid.h"

namespace hord::calib {

// Difference of a lenslet's light from the mean of its four neighbours', over that: robust RMS, without what the noise
// of a lenslet's light makes of it (`light_noise`: CentreFinder::light_noise() of some lenslets); 0 without neighbours.
double light_roughness(const algo::LensletGrid& grid, std::span<const Observation> observations,
                       std::vector<double> light_noise);

LightFollowing light_following(const algo::LensletGrid& grid, std::span<const Observation> observations);

SmoothResiduals smooth_residuals(const algo::LensletGrid& grid, std::span<const Observation> observations);

}  // namespace hord::calib
