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

// `finder_at`: what measures lenslets of the size of an observation. All 0 where less than 4 regions of the frame can
// be compared.
CutLenslets cut_lenslets(const WhiteImage& image, const algo::LensletGrid& grid,
                         std::span<const Observation> observations, const CentreFinder& middle,
                         const std::function<const CentreFinder&(const Observation&)>& finder_at);

}  // namespace hord::calib
