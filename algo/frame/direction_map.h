// The calibrated map from direction of light to position inside a lenslet: r(i,j) of the paper.
//
// Directions are angles in radians along the sensor's axes, x to the right and y down; (0, 0) is undeflected light,
// from a collimated frame of the empty field. calib/tilts finds the map from captures at known tilts; the calibration
// file stores it. Bins are equal steps of direction, so one factor converts bin pitches to radians. Only + - * / is
// used: the same file gives the same bits on every machine.
#pragma once

#include <vector>

#include "algo/frame/lenslet_grid.h"
#include "common/result.h"

namespace hord::algo {

struct DirectionRad {
    double x_rad = 0, y_rad = 0;
};

struct DirectionMap {
    // From direction / span_rad to px from the lenslet's centre (models: algo/frame/lenslet_grid.h).
    GridModelKind model = GridModelKind::similarity;
    std::vector<double> parameters;
    double span_rad = 1;   // largest tilt of the calibration
    double radius_px = 1;  // unit of the radial terms k1, k2

    PixelPoint zero_px;  // position of undeflected light, from the lenslet's centre; centre of the radial terms

    // Position of light of a direction, from the lenslet's centre.
    [[nodiscard]] PixelPoint place_px(DirectionRad direction) const;

    // Local derivative along x and along y, px a radian.
    [[nodiscard]] LensletGrid::Steps px_a_rad(DirectionRad direction) const;
};

// Checks counts, parameters and ranges. Fails with invalid_argument, naming the first problem.
Result<void> check(const DirectionMap& map);

// Positions of the bins of a lenslet on the sensor: the middle of each bin's box, from the lenslet's centre, j outer, i
// inner.
struct BinLayout {
    int bins_i = 0, bins_j = 0;
    std::vector<PixelPoint> offsets_px;
    double box_x_px = 0, box_y_px = 0;
    double step_i_rad = 0, step_j_rad = 0;  // one bin pitch; 0: no direction map
};

// Divides the mean pitch of the grid into I x J bins along the sensor's axes; undeflected light at the centre.
[[nodiscard]] BinLayout even_layout(const LensletGrid& grid, int bins_i, int bins_j);

// Bins of equal steps of direction about undeflected light.
[[nodiscard]] BinLayout layout_of(const LensletGrid& grid, const DirectionMap& map, int bins_i, int bins_j);

}  // namespace hord::algo
