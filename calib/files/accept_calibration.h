// Whether a fresh calibration may take the place of one in use.
#pragma once

#include "calib/files/grid_toml.h"
#include "common/result.h"

namespace hord::calib {

// Fails with `refused`, with the reason, where `fresh` is worse than `held`:
//   - it is of a frame of another size;
//   - it predicts lenslets that it has not seen worse than `held` does, by more than chance: the RMS of B blocks, two
//   axes, is known
//     to 1 / sqrt(4 B) of itself; two standard errors of the difference of both count as chance;
//   - it measured fewer of the complete lenslets, by more than one in a hundred;
//   - it has no direction map where `held` has one, or one that predicts captures worse by more than chance.
Result<void> accept_calibration(const GridFile& fresh, const GridFile& held);

}  // namespace hord::calib
