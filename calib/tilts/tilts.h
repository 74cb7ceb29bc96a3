// From captures of collimated light at known tilts to the direction map r(i,j).
//
// Collimated light from one direction is one spot in every lenslet, at the same place from its centre. The mean place
// of a capture, against its known direction, is one point of the map; tilts of a stage and deviations of known wedges
// serve alike. The capture without a tilt or part (the empty field) is what undeflected light looks like: it defines
// zero, not the stage.
//
// The rotation of the stage's axes against the sensor's cannot be told from a rotation of the map: directions are given
// along the sensor's axes (the map's linear part is made symmetric), and what is left over is reported as the stage's
// rotation.
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

// -- what was captured: tilts.toml, in the folder of the frames

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

// -- what one capture says

struct SpotPlace {
    algo::PixelPoint offset_px;  // from the lenslets' centres, mean over them without outliers
    algo::PixelPoint sigma_px;   // of that mean
    double spread_px = 0;        // of single lenslets, an axis
    int lenslets = 0;
};
// Fails with `refused` where there is no spot, or fewer than 4 lenslets show one; with invalid_argument for frames of
// another size.
Result<SpotPlace> measure_spots(const FrameView& frame, const std::optional<FrameView>& dark,
                                const std::optional<FrameView>& flat, const GridCalibration& grid);

// -- the map

struct Tilt {
    std::string name;
    algo::DirectionRad direction;  // of the stage or wedge
    SpotPlace spot;
};

struct DirectionFit {
    algo::DirectionMap map;
    std::vector<ModelReport> candidates;
    std::string reason;
    std::vector<double> sigma;  // one a parameter, px; 0 where fixed
    std::vector<Unobservable> unobservable;
    double noise_px = 0;                          // of one capture and axis, from the residuals
    double left_out_x_px = 0, left_out_y_px = 0;  // RMS of captures that the fit has not seen, each in turn
    double scale_px_a_rad = 0, scale_sigma = 0;   // mean over both axes, and its standard error
    double stage_rotation_rad = 0, stage_rotation_sigma = 0;
    bool mirrored = false;  // the stage's axes are a mirror image of the sensor's
    int captures = 0;       // the empty field's included
};

// Fails with `refused`, with the reason: fewer than three tilts besides the empty field; tilts nearly on one line (then
// the map across it is not known to 0.1 px at the lenslet's edge, each capture being good to 0.02 px); spots that
// follow no map to 0.1 px.
Result<DirectionFit> fit_directions(const SpotPlace& empty, std::span<const Tilt> tilts, double pitch_px);

}  // namespace hord::calib
