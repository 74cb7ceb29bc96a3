// Decides whether a new calibration may replace the one in use.
#pragma once

#include "calib/files/grid_toml.h"
#include "common/result.h"

namespace hord::calib {

// Fails with `refused`, with the reason, if `fresh` is worse than `held`:
//   - `held` names a camera, and it names another one or none: each sensor has a calibration of its own;
//   - its frame has another size, or its lattice another kind;
//   - its cross-validated error is larger by more than chance: two standard errors of the difference, where the RMS
//     over B blocks and two axes has the relative standard error 1 / sqrt(4 B);
//   - its share of measured lenslets is lower by more than 0.01;
//   - it has no direction map and `held` has one, or its map predicts captures worse by more than chance.
Result<void> accept_calibration(const GridFile& fresh, const GridFile& held);

}  // namespace hord::calib
