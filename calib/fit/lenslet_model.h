// The last rung of the ladder: every lenslet has a place of its own, as far from the model's as it was measured,
// shrunk.
//
// A block that was left out cannot tell where its lenslets are, so here each lenslet is asked twice: two halves of its
// light (calib/ centres.h) say where it is, with noise of their own. Each half predicts the other, its residual from
// the model (fitted without the block) shrunk by a share learned from the other blocks. The rung is taken when that
// beats the model alone by two standard errors over the blocks, and when the shifts exceed what the decode's places are
// rounded by. What moves one half only (dust, a scratch on a lenslet) counts as noise.
//
// With r_a, r_b the halves' residuals: S = mean(r_a r_b) is the variance of true shifts, N = mean((r_a - r_b)^2) / 4
// that of a whole centre's noise, and S / (S + N) of a residual is taken for true. Used by calib/fit/grid_fit.cpp only.
#pragma once

#include <span>

#include "calib/fit/grid_fit.h"

namespace hord::calib {

// Adds the rung's report to the ladder of `fit`; where it is taken, its shifts to the grid, and why to the reason.
void select_lenslet_shifts(std::span<const Observation> observations, GridFit& fit);

}  // namespace hord::calib
