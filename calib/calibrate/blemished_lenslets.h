// Lenslets whose light has another shape than that of their neighbours: a grain of dust or a scratch lies on them, and
// their centre is not that of the lenslet. Used by calib/calibrate only.
#pragma once

#include <functional>
#include <optional>
#include <span>

#include "calib/fit/grid_fit.h"
#include "calib/lattice/centres.h"

namespace hord::calib {

// Marks such lenslets `blemished`, not `used`, and takes shifts of their own from them: the outliers of the fit, and
// all lenslets where each has a shift. A lenslet is blemished if one of its shares in `unlike` is larger than those of
// the lenslets within two columns and rows: by `matters` than all of these but one, and by five of their robust
// standard deviations than their median. The shares of a lenslet that is dimmer than they are count by the square of
// its light, because noise has more of it. Where several neighbours are unlike together, something lies in the light
// in front of the array, and none is marked.
void mark_blemished(std::span<Observation> observations,
                    const std::function<std::optional<Unlike>(const Observation&)>& unlike, double matters,
                    GridFit& fit);

}  // namespace hord::calib
