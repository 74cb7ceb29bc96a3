// How much of a frame's light lies on the grid. Used by calib/calibrate only.
#pragma once

#include <cstddef>

#include "calib/calibrate/calibrate_grid.h"
#include "calib/lattice/white_image.h"

namespace hord::calib {

struct LightOnGrid {
    double share = 1;        // of the whole frame
    double worst = 1;        // of the worst region
    std::size_t region = 0;  // that one
};

// Share of the frame's bright pixels, those with half the light of the measured lenslets or more, that lie in the cells
// of these lenslets. Low where the light of a region does not fit the grid of the others: a part bends it, and scales
// its pattern. A region without light has no bright pixels. Lenslets that the frame's border cuts are not measured:
// what lies within 1.5 pitches of it does not count. 1 for a frame without any other bright pixel.
LightOnGrid light_on_grid(const WhiteImage& image, const GridCalibration& calibration);

}  // namespace hord::calib
