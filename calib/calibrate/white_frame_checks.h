// Is it a white frame, and does the grid fit all of it? What a small residual does not say: light beside the grid, a
// corner whose lenslets were left out, a pattern that is no lenslet array. Used by calib/calibrate/calibrate_grid.cpp
// only.
#pragma once

#include <string>
#include <vector>

#include "calib/calibrate/calibrate_grid.h"
#include "calib/lattice/white_image.h"
#include "common/result.h"

namespace hord::calib {

// Refuses what is no white frame, or a grid that does not fit all of the frame, with reason and cure. `calibration` has
// the fit and the counts up to here.
Result<void> check_white_frame(const WhiteImage& image, const GridCalibration& calibration);

// What a person should know before the grid is used, a sentence each with the cure; empty if all is well.
std::vector<std::string> warnings_about(const GridCalibration& calibration);

}  // namespace hord::calib
