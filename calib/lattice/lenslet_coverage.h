// Which lenslets a calibration can be expected to measure: those in the frame with their whole window, that light
// reaches whole.
//
// Light that fills only a part of the array (a telescope's pupil, a round stop) leaves lenslets without any, and those
// at its edge with a part of theirs, whose centre says where the light ends and not where the lenslet is. A lenslet
// that is dark alone, or in a row one wide, among lit ones is dead or dirty, and missing: that is the array's fault,
// and is not left out.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "algo/frame/lenslet_grid.h"
#include "calib/fit/grid_fit.h"

namespace hord::calib {

struct LensletCoverage {
    int lenslets = 0;  // complete, and light reaches them whole
    int found = 0;     // of these, measured
    int used = 0;      // of these, measured and fitting the grid
};

// How much light a lenslet at a place has, in DN: its share of the lenslets' own profile (CentreFinder::amplitude_dn).
using LensletLight = std::function<double(algo::PixelPoint)>;

// One a lenslet of the grid, row by row: 1 where it lies in the frame with its whole window (`complete` says so of a
// place) and light reaches it whole, 0 elsewhere. A lenslet without an observation is dark where it has less than a
// quarter of the light that is `typical_dn`; a dark region is where it and all its neighbours in rows and columns are
// dark, and what touches them.
std::vector<std::uint8_t> lenslet_coverage(const algo::LensletGrid& grid, std::span<const Observation> observations,
                                           const std::function<bool(algo::PixelPoint)>& complete,
                                           const LensletLight& light, double typical_dn);

}  // namespace hord::calib
