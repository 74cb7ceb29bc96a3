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

// What is left of the shift that straight edges cause: it depends on where between the pixels a lenslet lies.
// Subtracted there; learned from the residuals, over the place of the grid's model without the lenslet's own shift:
// where all lenslets lie alike between the pixels, or in few ways, waves over a place with that shift would explain the
// shift itself. There is nothing to learn from then.
void remove_pixel_phase(const algo::LensletGrid& grid, std::vector<Observation>& observations);

}  // namespace hord::calib
