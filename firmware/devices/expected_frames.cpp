#include "firmware/devices/expected_frames.h"

#include <filesystem>
#include <string>
#include <variant>
#include <vector>

#include <fmt/format.h>

#include "common/cli/message.h"
#include "drivers/files/frame_file.h"
#include "firmware/config/path_check.h"
#include "hal_sim/cell/scene_folder.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;

// The key before each line.
tl::unexpected<Error> of_key(const char* key, const Error& error, const std::string& more = {}) {
    return fail(error.code, named_lines(key, error.what), error.cure + more);
}

Result<void> check_size(const FrameFolder& recorded, const drivers::ExpectedFrame& frames) {
    const auto compare = [&](const char* key, int configured, int found) -> Result<void> {
        if (configured == 0 || configured == found) return {};
        return fail(ErrorCode::invalid_argument,
                    fmt::format("{} = {}, and the frames of {} are {}x{}", key, configured, recorded.folder.string(),
                                frames.width_px, frames.height_px),
                    fmt::format("set {} = {}, or play other frames", key, found));
    };
    auto fits = compare("sensor.width_px", recorded.width_px, frames.width_px);
    return fits ? compare("sensor.height_px", recorded.height_px, frames.height_px) : fits;
}

// Reads every frame: what the sensor refuses when it is opened stays so until a person changes a file.
Result<hal::SensorFormat> format_of_frames(const FrameFolder& recorded, const InspectionConfig& inspection) {
    constexpr const char* kKey = "sensor.folder";
    const auto files = drivers::list_frames({recorded.folder});
    if (!files) return of_key(kKey, files.error(), "; " + mounted_late(recorded.folder));
    drivers::RecordedSeries series(recorded.bits);
    std::vector<Error> problems;
    for (const fs::path& file : *files) {
        std::error_code none;
        if (fs::is_directory(file, none)) {
            problems.push_back({ErrorCode::invalid_argument, file.string() + " is a folder, and its name is a frame's",
                                "rename it, or name a folder of frames alone"});
        } else if (auto frame = series.read(file); !frame) {
            problems.push_back(frame.error());
        }
    }
    if (!problems.empty()) return of_key(kKey, drivers::all_of(problems));
    if (auto fits = check_size(recorded, series.format()); !fits) return tl::unexpected(fits.error());
    if (auto fits = check_geometry(series.noted(), inspection); !fits) return of_key(kKey, fits.error());
    const drivers::ExpectedFrame& format = series.format();
    return hal::SensorFormat{format.width_px, format.height_px, format.bits, drivers::RecordedFrames::kBuffers};
}

hal::SensorFormat format_of_scene(const sim::Scene& scene) {
    return {scene.camera.extents.width_px(), scene.camera.extents.height_px(), scene.camera.bits, 0};
}

}  // namespace

bool has_scene_files(const Config& config) {
    const auto* simulated = std::get_if<SimulatedSensor>(&config.sensor);
    return simulated != nullptr && !simulated->scenes.empty();
}

Result<sim::Production> configured_scenes(const Config& config, double good_share) {
    const auto& folder = std::get<SimulatedSensor>(config.sensor).scenes;
    auto parts = sim::load_production(folder, good_share);
    if (!parts) return parts;
    const algo::Extents& e = parts->scenes.front().camera.extents;
    if (e.i != config.inspection.bins_i || e.j != config.inspection.bins_j) {
        return fail(ErrorCode::invalid_argument,
                    fmt::format("the scenes of {} have {}x{} bins, and inspection.macro is \"{}x{}\"", folder.string(),
                                e.i, e.j, config.inspection.bins_i, config.inspection.bins_j),
                    fmt::format("set inspection.macro = \"{}x{}\", or use other scenes", e.i, e.j));
    }
    return parts;
}

Result<void> check_geometry(const std::optional<drivers::RecordedFrames::Noted>& noted,
                            const InspectionConfig& inspection) {
    if (!noted) return {};
    const algo::Extents& grid = noted->geometry.grid;
    const std::string says = noted->file + " says " + describe(noted->geometry);
    const auto refuse = [&](const std::string& configured, const std::string& cure) {
        return fail(ErrorCode::invalid_argument, says + ", and " + configured, cure);
    };
    if (noted->geometry.kind == drivers::FrameKind::raw) {
        if (!inspection.grid.empty()) return {};
        return refuse("inspection.grid names no calibration", "name the one of this sensor (hordctl calibrate)");
    }
    if (!inspection.grid.empty()) {
        return refuse("inspection.grid = \"" + inspection.grid.string() + "\" decodes raw frames",
                      "leave inspection.grid out, or play raw frames");
    }
    if (grid.i == inspection.bins_i && grid.j == inspection.bins_j) return {};
    return refuse(fmt::format("inspection.macro is \"{}x{}\"", inspection.bins_i, inspection.bins_j),
                  fmt::format("set inspection.macro = \"{}x{}\", or play other frames", grid.i, grid.j));
}

Result<std::optional<hal::SensorFormat>> expected_format(const Config& config) {
    if (const auto* const recorded = std::get_if<FrameFolder>(&config.sensor))
        return format_of_frames(*recorded, config.inspection);
    if (has_scene_files(config)) {
        const auto parts = configured_scenes(config, 1);
        if (!parts) return of_key("sensor.scenes", parts.error());
        return format_of_scene(parts->scenes.front());
    }
    if (std::holds_alternative<SimulatedSensor>(config.sensor))
        return format_of_scene(sim::line_lens(config.inspection.bins_i, config.inspection.bins_j));
    return std::nullopt;
}

}  // namespace hord::firmware
