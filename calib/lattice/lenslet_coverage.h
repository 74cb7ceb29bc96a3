// The lenslets that a calibration is expected to measure: complete in the frame and fully lit. Lenslets in and at the
// edge of dark regions (a pupil, a round stop) are not expected. A dark lenslet among lit ones, or a row of them one
// wide, is dead or dirty: it is expected and counts as missing.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "algo/frame/lenslet_grid.h"
#include "calib/fit/grid_fit.h"

namespace hord::calib {

// The light of a lenslet at a position, DN (CentreFinder::amplitude_dn).
using LensletLight = std::function<double(algo::PixelPoint)>;

// One a lenslet of the grid, row by row: 1 if it is complete in the frame (`complete`) and fully lit, else 0. A lenslet
// without an observation is dark if its light is below a quarter of `typical_dn`. A dark region consists of lenslets
// that are dark with all their neighbours, and of dark lenslets that touch these; its edge are the lenslets that touch
// it.
std::vector<std::uint8_t> lenslet_coverage(const algo::LensletGrid& grid, std::span<const Observation> observations,
                                           const std::function<bool(int m, int n)>& complete, const LensletLight& light,
                                           double typical_dn);

}  // namespace hord::calib
