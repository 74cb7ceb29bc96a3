// Light of which direction lands where inside a lenslet: r(i,j) of the paper, calibrated.
//
// Directions are angles in radians along the sensor's axes, x to the right and y down; (0, 0) is undeflected light, as
// the empty field's collimated frame shows it. `calib/` finds the map from captures at known tilts; the calibration
// file carries it. Bins are laid out evenly in direction, so that one step of i or j is the same angle everywhere and
// distances in bin pitches become radians by one factor. Only + - * / is used: the same file gives the same bits on
// every machine.
#pragma once

#include <vector>

#include "algo/frame/lenslet_grid.h"
#include "common/result.h"

namespace hord::algo {

struct DirectionRad {
    double x_rad = 0, y_rad = 0;
};

struct DirectionMap {
    GridModelKind model = GridModelKind::similarity;  // of the ladder of algo/frame/lenslet_grid.h, from direction /
                                                      // span_rad to px from the lenslet's centre
    std::vector<double> parameters;
    double span_rad = 1;   // largest tilt it was calibrated at
    double radius_px = 1;  // where the radial terms are k1, k2

    PixelPoint zero_px;  // where undeflected light lands, from the lenslet's centre; radial terms are about it

    // Where light of a direction lands, from the lenslet's centre.
    [[nodiscard]] PixelPoint place_px(DirectionRad direction) const;

    // The local step of a radian along x and along y, px.
    [[nodiscard]] LensletGrid::Steps px_a_rad(DirectionRad direction) const;
};

// Counts, parameters and ranges; invalid_argument names the first thing that is wrong.
Result<void> check(const DirectionMap& map);

// Where the bins of a lenslet lie on the sensor: one offset a bin from the lenslet's centre, j outer, i inner, each the
// middle of a box.
struct BinLayout {
    int bins_i = 0, bins_j = 0;
    std::vector<PixelPoint> offsets_px;
    double box_x_px = 0, box_y_px = 0;
    double step_i_rad = 0, step_j_rad = 0;  // one bin pitch; 0: not known, no direction map
};

// Steps that divide the mean pitch of the grid into I x J bins along the sensor's axes; undeflected light at the
// centre.
[[nodiscard]] BinLayout even_layout(const LensletGrid& grid, int bins_i, int bins_j);

// The same bins, as equal steps of direction about the undeflected one.
[[nodiscard]] BinLayout layout_of(const LensletGrid& grid, const DirectionMap& map, int bins_i, int bins_j);

}  // namespace hord::algo
