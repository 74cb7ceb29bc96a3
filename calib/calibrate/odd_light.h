// What of the lenslets' light a half turn about their centres changes, the same way for all lenslets: light that is
// brighter on one side of them, and two exposures of unequal strength. Used by calib/calibrate only.
#pragma once

#include <span>

#include "calib/calibrate/calibrate_grid.h"
#include "calib/lattice/white_image.h"

namespace hord::calib {

// From the lenslets that fit. Of spots `left_share` only: their shift looks like a gradient of their light.
OddLight odd_light(const WhiteImage& image, const CentreFinder& finder, std::span<const Observation> observations);

// Moves the grid and the measured centres by OddLight::shift_px.
void move_to_lenslets(GridCalibration& of);

}  // namespace hord::calib
