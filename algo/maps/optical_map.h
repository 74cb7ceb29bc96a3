// What a lens maker reads of a part: the deflection of its light along x and y, its power and its cylinder.
//
//   deflection_x, _y   mean slope of the light (Eq. 12), positive to the right and downwards; mrad, or bin pitches
//   where
//                      bin_rad is 0
//   power              mean power -(du/dx + dv/dy) / 2: positive where light converges (ISO 13666: spherical
//   equivalent) cylinder           difference of the two principal powers, sqrt((du/dx - dv/dy)^2 + (du/dy + dv/dx)^2),
//   >= 0
//
// Powers are in dioptres (1/m), at the measurement plane: 1 / (distance from that plane to the focus). Of a thin lens
// in that plane it is 1/f; of a thick one 1 / (f - (z - z_H')) with its rear principal plane at z_H'. Derivatives are
// those of the plane fitted to 5x5 lenslets, all of which must have a HORD; so the steps of the bins are partly
// averaged; they are smallest for a source radius of 0.61 bin, where their first harmonic J1(2 pi r) is 0. Test:
// tests/algo/maps/optical_map_test.cpp, against thin and thick lenses.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "algo/frame/decode.h"
#include "common/result.h"

namespace hord::algo {

enum class Optical : std::uint8_t { deflection_x, deflection_y, power, cylinder };
inline constexpr std::array<std::string_view, 4> kOpticalNames{"deflection-x", "deflection-y", "optical-power",
                                                               "cylinder-power"};

struct OpticalScale {
    double lenslet_mm = 0;  // pitch of the lenslets on the part; 0: not known
    double bin_rad = 0;     // slope of a bin; 0: not known
};

struct OpticalMap {
    std::vector<float> values;       // row by row; 0 where there is none
    std::vector<std::uint8_t> mask;  // MaskBit: kDark, kSaturated; kBorder where a neighbour has no HORD
};
// Fails with invalid_argument if the frame is not of these extents and bits, or powers are asked for without a scale.
Result<OpticalMap> optical_map(const FrameView& frame, const Extents& extents, int bits, const LightLevels& levels,
                               Optical what, const OpticalScale& scale);

}  // namespace hord::algo
