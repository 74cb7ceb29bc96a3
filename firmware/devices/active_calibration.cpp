#include "firmware/devices/active_calibration.h"

#include <algorithm>
#include <ctime>

#include <fmt/format.h>

#include "calib/files/accept_calibration.h"
#include "common/crc32.h"

namespace hord::firmware {
namespace {

// Refuses a calibration that is worse than the kept one. A kept one of another camera or size, or an unreadable one, is
// ignored.
Result<void> may_replace(const calib::GridFile& fresh, const std::filesystem::path& kept) {
    if (!std::filesystem::exists(kept)) return {};
    const auto held = calib::read_grid(kept);
    if (!held || held->stamp.camera != fresh.stamp.camera || held->grid.width_px != fresh.grid.width_px ||
        held->grid.height_px != fresh.grid.height_px)
        return {};
    const auto fine = calib::accept_calibration(fresh, *held);
    if (!fine)
        return fail(fine.error().code, "not used: " + fine.error().what,
                    "name a better one; or, if this one is meant, remove " + kept.string());
    return {};
}

Error named(const std::filesystem::path& file, const Error& error) {
    return {error.code, file.string() + ": " + error.what, error.cure};
}

}  // namespace

std::optional<std::uint32_t> ActiveCalibration::age_s() const {
    std::tm made{};
    if (::strptime(file.stamp.date.c_str(), "%Y-%m-%dT%H:%M:%SZ", &made) == nullptr) return std::nullopt;
    const std::int64_t seconds =
        static_cast<std::int64_t>(std::time(nullptr)) - static_cast<std::int64_t>(::timegm(&made));
    return static_cast<std::uint32_t>(std::clamp<std::int64_t>(seconds, 0, 0xFFFFFFFE));
}

Result<ActiveCalibration> read_calibration(const std::filesystem::path& file, int bins_i, int bins_j) {
    auto read = calib::read_grid(file);
    if (!read) return tl::unexpected(read.error());
    ActiveCalibration out{file, std::move(*read), 0, nullptr};
    auto decoder = algo::GridDecoder::create(out.file.grid, out.file.directions, bins_i, bins_j);
    if (!decoder) return tl::unexpected(named(file, decoder.error()));
    out.decoder = std::make_shared<const algo::GridDecoder>(std::move(*decoder));
    out.crc32 = common::crc32(calib::to_toml(out.file));
    return out;
}

Result<void> check_calibration(const ActiveCalibration& read, const std::filesystem::path& kept,
                               const hal::SensorFormat& format) {
    const algo::LensletGrid& grid = read.file.grid;
    if (grid.width_px != format.width_px || grid.height_px != format.height_px) {
        return fail(ErrorCode::invalid_argument,
                    fmt::format("{}: a calibration of frames of {}x{} px, but the sensor's are of {}x{}",
                                read.path.string(), grid.width_px, grid.height_px, format.width_px, format.height_px),
                    "calibrate this sensor (hordctl calibrate), or name its calibration in inspection.grid");
    }
    if (kept.empty()) return {};
    return may_replace(read.file, kept).map_error([&](const Error& error) { return named(read.path, error); });
}

std::optional<Error> other_camera(const ActiveCalibration& read, const std::filesystem::path& kept) {
    std::error_code none;
    if (kept.empty() || !std::filesystem::exists(kept, none)) return std::nullopt;
    const auto held = calib::read_grid(kept);
    const std::string& camera = read.file.stamp.camera;
    if (!held || held->stamp.camera == camera) return std::nullopt;
    return Error{ErrorCode::invalid_argument,
                 fmt::format("inspection.grid: {} is a calibration of camera \"{}\", the one in use before of \"{}\"",
                             read.path.string(), camera, held->stamp.camera),
                 "if the camera was not changed, name the calibration of this one"};
}

std::filesystem::path kept_calibration(const std::filesystem::path& state_folder) {
    return state_folder.empty() ? std::filesystem::path() : state_folder / "calibration-in-use.toml";
}

}  // namespace hord::firmware
