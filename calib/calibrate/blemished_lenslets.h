// Lenslets whose light has another shape than that of their neighbours: a grain of dust or a scratch lies on them, and
// their centre is not that of the lenslet. Used by calib/calibrate only.
#pragma once

#include <functional>
#include <optional>
#include <span>

#include "calib/fit/grid_fit.h"

namespace hord::calib {

// Marks such lenslets `blemished`, not `used`, and takes shifts of their own from them: the outliers of the fit, and
// all lenslets where each has a shift. `unlike`: the share of a lenslet's power that is not of the profile. A lenslet
// is blemished if its share is larger than those of the lenslets within two columns and rows: by `matters` than all of
// these but one, and by five of their robust standard deviations than their median. The share of a lenslet that is
// dimmer than they are counts by the square of its light, because noise has more of it. Where several neighbours are
// unlike together, something lies in the light in front of the array, and none is marked.
void mark_blemished(std::span<Observation> observations,
                    const std::function<std::optional<double>(const Observation&)>& unlike, double matters,
                    GridFit& fit);

}  // namespace hord::calib
