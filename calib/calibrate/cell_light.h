// The light of one lenslet's cell, sampled along the steps of its lattice. Used by calib/calibrate only.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "calib/fit/grid_fit.h"
#include "calib/lattice/white_image.h"

namespace hord::calib {

inline constexpr int kCells = 24;  // places along each step of the lattice, over one step

// Row by v, column by u: steps from the lenslet's centre, in the middle of cells.
using CellLight = Eigen::Array<double, kCells, kCells>;

inline double place_of(Eigen::Index k) { return (static_cast<double>(k) + 0.5) / kCells - 0.5; }

// The light about a lenslet, in steps along its lattice; none where that leaves the frame.
std::optional<CellLight> light_about(const WhiteImage& image, algo::PixelPoint centre,
                                     const algo::LensletGrid::Steps& steps);

}  // namespace hord::calib
