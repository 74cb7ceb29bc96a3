// What all lenslets of a frame have in common: light on one side, edges that are more blurred one way. Used by
// calib/calibrate/calibrate_grid.cpp only.
#pragma once

#include <complex>
#include <optional>
#include <span>

#include "calib/calibrate/calibrate_grid.h"

namespace hord::calib {

// The median gradient of the lenslets' light along x and y, its length (CentreFinder::gradient).
double one_sided(const CentreFinder& finder, const GridCalibration& of);

// The mean of the lenslets' corners, if they are squares (CentreFinder::lobes, four of them).
std::optional<std::complex<double>> four_lobes(const CentreFinder& finder, std::span<const Observation> observations);

// The median of the lenslets' blur (CentreFinder::edge_blur_px2). Without that across the rows (columns where these are
// staggered) of square lenslets on a hexagonal lattice: their neighbours are nearest there, and their light looks like
// blur.
EdgeBlur edge_blur(const CentreFinder& finder, const Lattice& lattice, std::span<const Observation> observations);

}  // namespace hord::calib
