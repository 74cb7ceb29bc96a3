// The last candidate model: every lenslet has a shift of its own, its measured residual times a factor below 1.
//
// Leaving out a block says nothing about shifts of its lenslets. So each lenslet is measured twice, by two halves of
// its light with independent noise (CentreFinder::split). Each half predicts the other: its residual from the model
// (fitted without the block) times a factor learned from the other blocks. The candidate is selected if that beats the
// model alone by two standard errors over the blocks, and if the shifts exceed the rounding of positions in the decode.
// A shift of one half only (dust, a scratch on a lenslet) counts as noise.
//
// With r_a, r_b the halves' residuals: S = mean(r_a r_b) is the variance of true shifts, N = mean((r_a - r_b)^2) / 4
// that of the noise of a centre, and S / (S + N) is the factor. Used by calib/fit/grid_fit.cpp only.
#pragma once

#include <span>

#include "calib/fit/grid_fit.h"

namespace hord::calib {

// Adds the report to the candidates of `fit`. If selected, adds the shifts to the grid and the reason to `fit.reason`.
void select_lenslet_shifts(std::span<const Observation> observations, GridFit& fit);

}  // namespace hord::calib
