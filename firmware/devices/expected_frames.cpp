#include "firmware/devices/expected_frames.h"

#include <algorithm>
#include <bit>
#include <cstdint>
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

// A note says the depth: another one in sensor.bits is a mistake in one of the two.
Result<void> check_depth(const FrameFolder& recorded, const std::optional<drivers::RecordedSeries::Noted>& noted) {
    if (!noted || recorded.bits == 0 || recorded.bits == noted->geometry.bits) return {};
    return fail(
        ErrorCode::invalid_argument,
        fmt::format("{} says {}, and sensor.bits is {}", noted->file, describe(noted->geometry), recorded.bits),
        fmt::format("leave sensor.bits out (the depth is then {}), or play other frames", noted->geometry.bits));
}

// Frames of 16 bits whose depth nothing says. Sensors of 10, 12 and 14 bits deliver such files, too, and would be too
// dark: at full light the samples of a sensor of 14 bits reach a quarter of the range.
Result<void> check_unsaid_depth(const FrameFolder& recorded, const drivers::RecordedSeries& series,
                                std::uint32_t largest) {
    constexpr int kLargestOfFewer = 14;  // bits of a sensor that has fewer than 16
    const int needed = std::bit_width(largest);
    if (recorded.bits != 0 || series.noted() || series.format().bits != 16 || needed > kLargestOfFewer) return {};
    const std::string wide = needed > 12
        ? "16, with saturated_dn = 16383 in the recipe's [light] for samples of 14 bits"
        : fmt::format("{}; 16 if all bits count", needed > 10 ? "12" : "10 or 12");
    return fail(ErrorCode::invalid_argument,
                fmt::format("the frames of {} have 16-bit samples, nothing says how many of the bits count, and the "
                            "largest sample is {}, which {} bits hold",
                            recorded.folder.string(), largest, std::max(needed, 1)),
                "set sensor.bits to the sensor's depth: " + wide);
}

// Of a frame with two bytes a sample; 0 of another.
std::uint32_t largest_sample(const FrameView& frame) {
    std::uint32_t largest = 0;
    for (int y = 0; frame.bits > 8 && y < frame.height_px; ++y)
        largest = std::max<std::uint32_t>(largest, *std::max_element(frame.row16(y), frame.row16(y) + frame.width_px));
    return largest;
}

// Reads every frame: what the sensor refuses when it is opened stays so until a person changes a file.
Result<hal::SensorFormat> format_of_frames(const FrameFolder& recorded, const InspectionConfig& inspection) {
    constexpr const char* kKey = "sensor.folder";
    const auto files = drivers::list_frames({recorded.folder});
    if (!files) return of_key(kKey, files.error(), "; " + mounted_late(recorded.folder));
    drivers::RecordedSeries series(recorded.bits);
    std::vector<Error> problems;
    std::uint32_t largest = 0;
    for (const fs::path& file : *files) {
        if (auto frame = series.read(file); !frame) {
            problems.push_back(frame.error());
        } else {
            largest = std::max(largest, largest_sample(frame->view()));
        }
    }
    if (auto fits = check_depth(recorded, series.noted()); !fits) return of_key(kKey, fits.error());
    if (!problems.empty()) return of_key(kKey, drivers::all_of(problems));
    if (auto fits = check_size(recorded, series.format()); !fits) return tl::unexpected(fits.error());
    if (auto fits = check_geometry(series.noted(), inspection); !fits) return of_key(kKey, fits.error());
    if (auto said = check_unsaid_depth(recorded, series, largest); !said) return of_key(kKey, said.error());
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
