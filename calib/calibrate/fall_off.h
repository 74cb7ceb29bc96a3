// How the light of the lenslets falls off over the frame.
#pragma once

#include <span>

#include "calib/fit/grid_fit.h"

namespace hord::calib {

// The relative change of light a pixel, |grad L| / L, of the smooth part of the lenslets' light (a paraboloid).
struct FallOff {
    double rms_per_px = 0, max_per_px = 0;  // over the lenslets
};
FallOff fall_off(std::span<const Observation> observations);

}  // namespace hord::calib
