// Pictures of a calibration, for a person who must decide whether to accept it.
#pragma once

#include <filesystem>

#include "calib/calibrate/calibrate_grid.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::firmware {

// Writes into `folder` (made if need be):
//   residuals.png  the residual of every lenslet: an enlarged arrow, coloured by its length
//   centres.png    the white frame with every lenslet of the grid: measured, missing, displaced (with a place of its
//   own) or rejected models.png     each model's error on held-out lenslets, and the selected model
// Fails with io.
Result<void> write_calibration_pictures(const std::filesystem::path& folder, const FrameView& white,
                                        const calib::GridCalibration& found);

}  // namespace hord::firmware
