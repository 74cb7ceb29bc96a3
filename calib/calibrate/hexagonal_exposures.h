// Two exposures on a hexagonal lattice, of lenslets with four lobes. Such light is that of squares, of discs that are
// exposed twice, or of squares that are: each harmonic of the lattice alone fits all three. So lenslets of each kind
// are fitted to the mean light, with their neighbours' light.
#pragma once

#include <complex>
#include <optional>
#include <span>

#include "calib/calibrate/calibrate_grid.h"

namespace hord::calib {

// How much more the lenslets are blurred along the way between the exposures; `more_px2` is 0 if lenslets of one
// exposure fit nearly as well. `lobes` are those of the lenslets (CentreFinder::lobes, four). None if neither squares
// nor discs fit to 1 % of their light (RMS).
std::optional<EdgeBlur> hexagonal_exposures(const WhiteImage& image, const algo::LensletGrid& grid,
                                            std::span<const Observation> observations, std::complex<double> lobes);

}  // namespace hord::calib
