// The files that a start needs, read and checked once: by `hordd --check`, and by a start before anything is rendered.
#pragma once

#include <optional>
#include <vector>

#include "algo/frame/extents.h"
#include "common/result.h"
#include "drivers/hal/sensor.h"
#include "firmware/config/config.h"
#include "firmware/devices/active_calibration.h"
#include "firmware/recipes/recipe_file.h"

namespace hord::firmware {

struct StationFiles {
    NumberedRecipe recipe;                         // inspection.recipe, or the default; with its reference
    std::optional<ActiveCalibration> calibration;  // inspection.grid
};

// Fails if the files cannot be used, or not with each other: recipe, calibration, frames or scenes. That stays so until
// a person changes something. All problems, one a line, each with its key or file and its cure. Of a camera the size of
// its frames is not known yet: Service::open() compares it.
Result<StationFiles> read_station_files(const Config& config);

// Size of the light field: of the calibration for raw frames, or of macro-pixels that divide the frame.
Result<algo::Extents> light_field_of(const InspectionConfig& inspection,
                                     const std::optional<ActiveCalibration>& calibration,
                                     const hal::SensorFormat& format);

// Told at a start and by --check: what the configuration allows and is hardly meant (notes(config)), that nothing is
// stored, recipes of which two have one number.
std::vector<Error> start_notes(const Config& config);

}  // namespace hord::firmware
