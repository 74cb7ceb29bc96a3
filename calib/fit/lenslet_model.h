// The last candidate model: every lenslet has a shift of its own, its measured residual times a factor below 1. It is
// selected if, over the blocks, one half of each lenslet's light (CentreFinder::split) predicts the other better than
// the model alone by two standard errors, and if the shifts exceed the rounding of positions in the decode. The factor
// and why halves: docs/notes/calibration.md. Used by calib/fit/grid_fit.cpp only.
#pragma once

#include <span>

#include "calib/fit/grid_fit.h"

namespace hord::calib {

// Adds the report to the candidates of `fit`. If selected, adds the shifts to the grid and the reason to `fit.reason`.
void select_lenslet_shifts(std::span<const Observation> observations, GridFit& fit);

}  // namespace hord::calib
