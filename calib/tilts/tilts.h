// Calibrates the direction map r(i,j) from captures of collimated light at known tilts of a stage, or through known
// wedges. The mean offset of a capture's spots from the lenslets' centres and its known direction are one point of the
// map. The capture without tilt and part (the empty field) defines zero. Directions are along the sensor's axes (the
// linear part of the map is symmetric); the remainder is reported as the rotation of the stage.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "algo/frame/direction_map.h"
#include "calib/calibrate/calibrate_grid.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::calib {

// -- the list of captures: tilts.toml, in the folder of the frames

struct TiltEntry {
    std::string frame;  // file, relative to the folder
    algo::DirectionRad direction;
};
struct TiltList {
    std::string empty;       // the empty field's collimated frame, required
    std::string dark, flat;  // optional
    std::vector<TiltEntry> tilts;
};
// Angles as `x_rad`, `y_rad`, or `x_deg`, `y_deg`. Fails with invalid_argument, all problems with file and line.
Result<TiltList> parse_tilts(std::string_view text, std::string_view name);
Result<TiltList> read_tilts(const std::filesystem::path& file);

// -- one capture

struct SpotPlace {
    algo::PixelPoint offset_px;  // from the lenslets' centres, robust mean
    int lenslets = 0;            // measured
};
// Fails with `refused` if fewer than 4 lenslets show a spot, with invalid_argument for frames of another size.
Result<SpotPlace> measure_spots(const FrameView& frame, const std::optional<FrameView>& dark,
                                const std::optional<FrameView>& flat, const GridCalibration& grid);

// -- the map

struct Tilt {
    std::string name;
    algo::DirectionRad direction;  // of the stage or wedge
    SpotPlace spot;
};

// Quality of the direction map.
struct DirectionStatistics {
    std::string reason;                           // why this model
    std::vector<double> sigma;                    // one a parameter, px; 0 where fixed
    double noise_px = 0;                          // of one capture and axis, from the residuals
    double left_out_x_px = 0, left_out_y_px = 0;  // RMS error of captures, each left out in turn
    double scale_px_a_rad = 0, scale_sigma = 0;   // mean over both axes, and its standard error
    double stage_rotation_rad = 0, stage_rotation_sigma = 0;
    bool mirrored = false;  // the stage's axes are a mirror image of the sensor's
    int captures = 0;       // including the empty field
};

struct DirectionFit : DirectionStatistics {
    algo::DirectionMap map;
    std::vector<ModelReport> candidates;
    std::vector<Unobservable> unobservable;
};

// Fails with `refused`, with the reason: fewer than three tilts besides the empty field; tilts nearly on one line (the
// map across it would be known worse than to 0.1 px at the lenslet's edge, with captures known to 0.02 px); spots that
// no map predicts to 0.1 px.
Result<DirectionFit> fit_directions(const SpotPlace& empty, std::span<const Tilt> tilts, double pitch_px);

}  // namespace hord::calib
