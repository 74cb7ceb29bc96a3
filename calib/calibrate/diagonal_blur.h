// Lenslets with corners whose light is blurred along one diagonal of the lattice more than along the other: exposed
// twice, or moved. Used by calib/calibrate/calibrate_grid.cpp only. docs/notes/calibration.md says what it sees.
#pragma once

#include <complex>
#include <span>

#include "calib/calibrate/calibrate_grid.h"
#include "calib/lattice/white_image.h"

namespace hord::calib {

// The median of some lenslets' blur along one diagonal, less that along the other. `lobes`: the mean of the
// lenslets' corners (four_lobes). `smooth_px2`: variance of the Gaussian that `image` was smoothed with, which is no
// blur of the lenslets. All 0 where nothing can be measured, or where no step of the lattice lies along the lenslets'
// sides.
EdgeBlur diagonal_blur(const WhiteImage& image, const algo::LensletGrid& grid,
                       std::span<const Observation> observations, std::complex<double> lobes, double smooth_px2);

}  // namespace hord::calib
