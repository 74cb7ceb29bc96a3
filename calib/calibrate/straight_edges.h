// Lenslets with straight edges, as squares have: how far the lenslets of a frame have corners, and what is left of the
// shift that their edges cause. Used by calib/calibrate/calibrate_grid.cpp only.
#pragma once

#include <span>
#include <vector>

#include "algo/frame/lenslet_grid.h"
#include "calib/fit/grid_fit.h"
#include "calib/lattice/centres.h"
#include "calib/lattice/lattice.h"

namespace hord::calib {

// Straight edges lie alike on the pixels along their whole length, and pixels sample the narrow weight coarsely:
// centres of lenslets with corners are off by up to 0.13 px. So such frames are smoothed.
constexpr double kMaxCorners = 0.01;
constexpr double kSmooth = 1;  // px, sigma

// How far the lenslets near the seed have corners: the part of their light with lobes (CentreFinder::lobes), four of a
// square lattice and six of a hexagonal one that lie between the neighbours. Square lenslets on a hexagonal lattice
// have four lobes, whichever way their sides lie; 0 for round ones, below 0 for crosses and stars towards the
// neighbours.
double corners_of(const CentreFinder& finder, const Lattice& lattice, std::span<const algo::PixelPoint> places);

// What is left of the shift that straight edges cause: it depends on where between the pixels a lenslet lies. Learned
// from the residuals and subtracted. The place is that of the grid, with the lenslet's own shift if it has one:
// the noise of a centre moves it between the pixels, so that the measured place would explain the noise as well. Where
// all lenslets lie alike between pixels, there is nothing to learn from.
void remove_pixel_phase(const algo::LensletGrid& grid, std::vector<Observation>& observations);

}  // namespace hord::calib
