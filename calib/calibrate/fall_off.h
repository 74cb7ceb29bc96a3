// How the light of the lenslets falls off over the frame.
#pragma once

#include <span>

#include "calib/calibrate/calibrate_grid.h"

namespace hord::calib {

// The relative change of light a pixel, |grad L| / L, of the smooth part of the lenslets' light (a paraboloid).
struct FallOff {
    double rms_per_px = 0, max_per_px = 0;  // over the lenslets
};
FallOff fall_off(std::span<const Observation> observations);

// True if the grid measured again with a weight that is immune to gradients is the better one: fall-off moves centres
// by more, RMS, than that weight adds to the noise of the grid, and the grid has moved by no more than fall-off and
// noise explain. Lenslets that differ in shape over the frame move it farther, because that weight answers more to
// them. Nor may the second grid have more outliers: where lenslets nearly touch, that weight sees their neighbours'
// light.
bool replaces(const GridCalibration& first, const GridCalibration& again, double by_fall_off_px);

}  // namespace hord::calib
