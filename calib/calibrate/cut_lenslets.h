// Lenslets that the stop of the optics cuts (cat's-eye vignetting), by the shape of their light. Their centres move as
// those of another pitch do, so that no residual shows it. Used by calib/calibrate/calibrate_grid.cpp only.
// docs/notes/calibration.md says what it sees.
#pragma once

#include <functional>
#include <optional>
#include <span>

#include "algo/frame/lenslet_grid.h"
#include "calib/calibrate/calibrate_grid.h"

namespace hord::calib {

// `measure`: the shape of a measured lenslet; called for some of them. All 0 where less than 4 regions of the frame can
// be compared.
CutLenslets cut_lenslets(const algo::LensletGrid& grid, std::span<const Observation> observations,
                         const std::function<std::optional<Elongation>(const Observation&)>& measure);

}  // namespace hord::calib
