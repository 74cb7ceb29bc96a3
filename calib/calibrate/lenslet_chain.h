// Numbers lenslets from neighbour to neighbour: each is predicted from the measured ones around it, with their own
// local pitch, so that no model of the whole frame has to hold. Used by calib/calibrate/calibrate_grid.cpp only.
#pragma once

#include <vector>

#include "algo/frame/lenslet_grid.h"
#include "calib/calibrate/local_finders.h"
#include "calib/fit/grid_fit.h"
#include "calib/lattice/centres.h"
#include "common/result.h"

namespace hord::calib {

// A range of lenslets (m, n).
struct IndexRange {
    int low_m = 0, high_m = 0, low_n = 0, high_n = 0;
    void include(int m, int n);
    friend bool operator==(const IndexRange&, const IndexRange&) = default;
};

struct LensletChain {
    std::vector<Observation> observations;  // every lenslet measured, row by row
    IndexRange inside;                      // of the lenslets inside the frame
    algo::LensletGrid smooth;               // polynomial through the centres
    int apart = 0;  // measured, but no chain of neighbours leads to them: their numbers are those of `smooth`
    int torn = 0;   // pairs of neighbours of the same chain that are not one local pitch apart
};

// Measures every lenslet of the frame. `steps`: the affine grid of the lattice, lenslet (0, 0) at the seed. Where no
// chain of neighbours leads (light in separate regions), lenslets are looked for where a polynomial through the others
// expects them. Adds finders for other sizes of lenslets where these are met. Fails with `refused` if too few lenslets
// can be measured.
Result<LensletChain> follow_chains(const WhiteImage& image, LocalFinders& finders, const algo::LensletGrid& steps,
                                   double pitch_px);

// Every lenslet that `grid` places inside the frame; `steps` bounds the search, because a polynomial may fold lenslets
// far outside back into the frame.
struct LensletPlace {
    int m = 0, n = 0;
    algo::PixelPoint at;
};
std::vector<LensletPlace> lenslets_inside(const algo::LensletGrid& grid, const algo::LensletGrid& steps,
                                          double reach_px = 1e9);

}  // namespace hord::calib
