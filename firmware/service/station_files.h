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
#include "firmware/recipes/recipe_folder.h"

namespace hord::firmware {

// What a recipe must fit.
struct LightField {
    algo::Extents extents;
    int bits = 0;
};

struct StationFiles {
    NumberedRecipe recipe;                         // inspection.recipe, or the default; with its reference
    std::optional<ActiveCalibration> calibration;  // inspection.grid
    std::optional<LightField> light_field;         // none: of a camera, which tells it when it is open
};

// Fails if the files cannot be used, or not with each other: recipe, calibration, frames or scenes. That stays so until
// a person changes something. All problems, one a line, each with its key or file and its cure. Of a camera the size of
// its frames is not known yet: Service::open() compares it.
Result<StationFiles> read_station_files(const Config& config);

// The recipe of a file that can be selected, if it fits the light field, as selecting it will ask. Names the file.
Result<void> check_selectable(const RecipeEntry& entry, const std::optional<LightField>& light_field);

// Size of the light field: of the calibration for raw frames, or of macro-pixels that divide the frame.
Result<algo::Extents> light_field_of(const InspectionConfig& inspection,
                                     const std::optional<ActiveCalibration>& calibration,
                                     const hal::SensorFormat& format);

// Of the recipe that was in use or learned before the restart: why the next start will not use it. Writes nothing.
std::vector<Error> problems_of_kept_recipe(const Config& config, const StationFiles& files);

// Told at a start and by --check: what the configuration allows and is hardly meant (notes(config)), that nothing is
// stored, recipes of which two have one number.
std::vector<Error> start_notes(const Config& config);

}  // namespace hord::firmware
