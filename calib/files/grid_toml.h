// The calibration file: lenslet grid, origin and quality, as readable TOML.
//
// The first line is a checksum (FNV-1a, 64 bits) over all bytes after it: an edited file is refused. `version` is 1, or
// 2 if lenslets have shifts of their own (table [lenslets]: thousandths of a pixel, one line a lattice row), or 3 if
// the model is one that readers of version 2 do not know (similarity+k1, division, rational). Files of other versions
// are refused.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "algo/frame/direction_map.h"
#include "algo/frame/lenslet_grid.h"
#include "calib/calibrate/calibrate_grid.h"
#include "calib/tilts/tilts.h"
#include "common/result.h"

namespace hord::calib {

inline constexpr int kGridFileVersion = 3;

inline constexpr std::string_view kUnnamedCamera = "unnamed";

// Origin, given by the caller; written unchanged.
struct GridStamp {
    std::string camera;       // identity: model and serial number; kUnnamedCamera if not known
    std::string date;         // ISO 8601
    std::string white, dark;  // names of the frames
};

struct GridStatistics {
    int complete = 0, found = 0, missing = 0, rejected = 0, saturated = 0, blocks = 0;
    double rms_x_px = 0, rms_y_px = 0, max_px = 0, cv_x_rms_px = 0, cv_y_rms_px = 0;
    double noise_px = 0, correlation_inflation = 1;
    LensletShifts shifts = {};  // all 0 if the grid has none
};

struct GridFile {
    algo::LensletGrid grid;
    std::optional<algo::DirectionMap> directions;  // none: calibrated without tilts
    DirectionStatistics direction_statistics;
    GridStamp stamp;
    GridStatistics statistics;
    std::string reason;         // why this model
    std::vector<double> sigma;  // of the parameters, px; 0 where fixed
    std::string fixed;          // names of unobservable parameters, comma separated
};

[[nodiscard]] GridFile file_of(const GridCalibration& calibration, const GridStamp& stamp);
void add_directions(GridFile& file, const DirectionFit& fit);
[[nodiscard]] std::string to_toml(const GridFile& file);

// Fails with invalid_argument (all problems, with file and line; another kind of file), unreadable (no checksum, or a
// wrong one) or unsupported (another version).
Result<GridFile> parse_grid(std::string_view text, std::string_view name);

// Writes a temporary file and renames it: readers see the old file or the complete new one. Fails as
// common::write_atomically().
Result<void> write_grid(const std::filesystem::path& path, const GridFile& file);
Result<GridFile> read_grid(const std::filesystem::path& path);

// m,n,x_px,y_px: one line for every lenslet of the fitted grid inside the frame. Fails with io.
Result<void> write_centres(const std::filesystem::path& path, const GridCalibration& calibration);

}  // namespace hord::calib
