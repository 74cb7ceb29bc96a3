#include "firmware/service/station_files.h"

#include <utility>
#include <variant>

#include <fmt/format.h>

#include "algo/inspection/pipeline.h"
#include "common/assign.h"
#include "common/cli/message.h"
#include "common/toml_fields.h"
#include "firmware/config/path_check.h"
#include "firmware/devices/expected_frames.h"
#include "firmware/recipes/recipe_folder.h"
#include "firmware/store/recorder/store_setup.h"

namespace hord::firmware {
namespace {

// Whether the frames fit the calibration, and the light field the recipe.
Result<void> check_together(const Config& config, StationFiles& files, const hal::SensorFormat& format) {
    const InspectionConfig& inspection = config.inspection;
    if (files.calibration) {
        const auto kept = kept_calibration(config.state_folder);
        if (auto fits = check_calibration(*files.calibration, kept, format); !fits) return fits;
    }
    const auto extents = light_field_of(inspection, files.calibration, format);
    if (!extents) {
        Error error = extents.error();
        if (const auto* const recorded = std::get_if<FrameFolder>(&config.sensor))
            error.what = fmt::format("sensor.folder: the frames of {}: {}", recorded->folder.string(), error.what);
        return tl::unexpected(error);
    }
    files.light_field = {*extents, format.bits};
    return algo::check_recipe(files.recipe.recipe, *extents, format.bits).map_error([&](Error error) {
        if (!inspection.recipe.empty())
            error.what = fmt::format("inspection.recipe: {}: {}", inspection.recipe.string(), error.what);
        return error;
    });
}

// The error of reading the file that a key names.
Error of_key(const char* key, const std::filesystem::path& file, Error error) {
    error.what = named_lines(key, error.what);
    if (error.code == ErrorCode::not_found) error.cure += "; " + mounted_late(file);
    return error;
}

}  // namespace

Result<void> check_selectable(const RecipeEntry& entry, const std::optional<LightField>& light_field) {
    if (!entry.recipe) return tl::unexpected(entry.recipe.error());
    if (!light_field) return {};
    const std::string reference = entry.recipe->reference_file.string();
    return algo::check_recipe(entry.recipe->recipe, light_field->extents, light_field->bits)
        .map_error([&](Error error) {
            error.what = fmt::format("{}: {}{}", entry.file.string(), error.what,
                                     reference.empty() ? "" : " (its reference: " + reference + ")");
            return error;
        });
}

Result<algo::Extents> light_field_of(const InspectionConfig& inspection,
                                     const std::optional<ActiveCalibration>& calibration,
                                     const hal::SensorFormat& format) {
    if (calibration) return calibration->decoder->extents();
    return algo::extents_of_frame(format.width_px, format.height_px, inspection.bins_i, inspection.bins_j)
        .map_error([](Error error) {
            error.cure =
                "set sensor.width_px and height_px to whole lenslets, inspection.macro to the bins of one, or "
                "inspection.grid to the calibration";
            return error;
        });
}

Result<StationFiles> read_station_files(const Config& config) {
    common::TomlProblems found;
    const auto note = [&](const Result<void>& result) {
        if (!result) found.add(result.error());
    };
    StationFiles files;
    const InspectionConfig& inspection = config.inspection;
    note(assign(files.recipe, recipe_or_default(inspection.recipe).map_error([&](const Error& error) {
        return of_key("inspection.recipe", inspection.recipe, error);
    })));
    if (!inspection.grid.empty()) {
        auto read = read_calibration(inspection.grid, inspection.bins_i, inspection.bins_j);
        note(assign(files.calibration, std::move(read).map_error([&](Error error) {
            error.cure += std::string(error.cure.empty() ? "" : "; or ") +
                "name another calibration (hordctl calibrate makes one)";
            return of_key("inspection.grid", inspection.grid, error);
        })));
    }
    std::optional<hal::SensorFormat> format;
    note(check_sources(config).and_then([&](const auto&) { return assign(format, expected_format(config)); }));
    if (found.empty() && format) note(check_together(config, files, *format));
    if (!found.empty()) return found.as_error();
    return files;
}

std::vector<Error> start_notes(const Config& config) {
    std::vector<Error> all = notes(config);
    if (auto note = nothing_is_stored(config)) all.push_back(std::move(*note));
    if (auto selectable = check_recipe_numbers(config.inspection.recipes); !selectable) {
        // The folder that no key names need not exist.
        const bool is_default = config.inspection.recipes == config.file.parent_path() / "recipes";
        if (!is_default || selectable.error().code != ErrorCode::not_found) all.push_back(selectable.error());
    }
    return all;
}

}  // namespace hord::firmware
