// Lenslets that the missing light of a dead neighbour moves. Where lenslets nearly touch, a part of the neighbours'
// light lies in a lenslet's window; the same from all sides, it moves no centre. Without the light of one neighbour the
// centre moves along the line to it, and the lenslet is an outlier of the fit though the grid is right there.
#pragma once

#include <functional>
#include <span>

#include "calib/fit/grid_fit.h"

namespace hord::calib {

// Marks the outliers of the fit that lie beside lenslets for which `missing(m, n)` holds, and are off the grid as the
// others beside missing ones are: the same way along the line, not across it, and by at most twice the median. Returns
// their number.
int mark_beside_missing(const algo::LensletGrid& grid, std::span<Observation> observations,
                        const std::function<bool(int m, int n)>& missing);

}  // namespace hord::calib
