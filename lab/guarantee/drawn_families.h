// Families of good parts whose form varies, drawn by closed formulas instead of traced: cheap enough for thousands of
// parts with each of a hundred seeds.
//
// Fields of 12x18 lenslets of 9x9 bins that the part fills, 12 bits, 2,000 electrons a lenslet, one electron a DN, read
// noise 2 electrons. Each part has its own pose (+-0.5 lenslet), tilt (0.03 bins), power (1 %), waviness (0.02 bins,
// period 4 to 12 lenslets), ripple of the light from lenslet to lenslet (1 %, with the part) and brightness (+-10 %).
// 1 % of ripple is the sensor's own. All are normally distributed but pose, period and brightness.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "algo/frame/extents.h"
#include "common/frame.h"

namespace hord::lab {

inline constexpr algo::Extents kFamilyExtents{12, 18, 9, 9};
inline constexpr int kFamilyBits = 12;

// lens, steep lens, plate, wedge, vial, strips of slope 0.05, 0.5, 1 and 1.5 (bins over two lenslets), freeform.
std::span<const std::string_view> drawn_families();

// Part `number` of a stream of a seed; `exposure`: another draw of photon and read noise.
Frame draw_good_part(std::size_t family, std::uint64_t seed, std::uint32_t stream, std::uint32_t number,
                     std::uint32_t exposure = 0);

}  // namespace hord::lab
