// What the mean lenslet of a frame looks like. Used by calib/calibrate only.
#pragma once

#include "calib/calibrate/calibrate_grid.h"
#include "calib/lattice/white_image.h"

namespace hord::calib {

// Of the frame's harmonics at the lattice's frequencies, from the mean lenslet of the grid.
PatternShape shape_of(const WhiteImage& image, const GridCalibration& calibration);

}  // namespace hord::calib
