// Families of good parts whose form varies, drawn by closed formulas instead of traced: cheap enough for thousands of
// parts with each of a hundred seeds.
//
// Fields of 12x18 lenslets of 9x9 bins that the part fills, 12 bits, 2,000 electrons a lenslet, one electron a DN, read
// noise 2 electrons. Each part has its own pose (+-0.5 lenslet), tilt (0.03 bins), power (1 %), waviness (0.02 bins,
// period 4 to 12 lenslets), ripple of the light from lenslet to lenslet (1 %, with the part) and brightness (+-10 %).
// 1 % of ripple is the sensor's own. All are normally distributed but pose, period and brightness.
//
// A flaw lies at least two lenslets from the border and takes, moves or scatters the light of the part of each lenslet
// that it covers (16x16 points a lenslet). Sizes as in lab/detection/detection_parts.h.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "algo/frame/extents.h"
#include "common/frame.h"

namespace hord::lab {

inline constexpr algo::Extents kFamilyExtents{12, 18, 9, 9};
inline constexpr int kFamilyBits = 12;

// lens, steep lens, plate, wedge, vial, strips of slope 0.05, 0.5, 1 and 1.5 (bins over two lenslets), freeform.
std::span<const std::string_view> drawn_families();

enum class DrawnFlaw : std::uint8_t {
    bubble,   // a disc without light, radius log-uniform from 0.05 to 1.5 lenslets
    scratch,  // a band without light, 8 lenslets long, half width 0.15 lenslet
    dimple,   // a shallow hollow, radius 1.5 lenslets: deflects away from its middle, by 0.5 bin at its edge
    stria,  // a band 8 lenslets long, half width 1.4 lenslets: one half deflects by 0.1 bin to one side, the other back
    haze,   // a disc, radius 1.2 lenslets: spreads a tenth of the light by a Gaussian of one bin
    speck,  // a disc, radius 1 lenslet: lets half of the light through
};
inline constexpr std::array<std::string_view, 6> kDrawnFlaws = {"bubble", "scratch", "dimple",
                                                                "stria",  "haze",    "speck"};

struct DrawnPart {
    Frame frame;
    double m = 0, n = 0, size = 0;  // middle of the flaw, lenslets; radius or half width
};

// Part `number` of a stream of a seed; `exposure`: another draw of photon and read noise.
DrawnPart draw_part(std::size_t family, std::uint64_t seed, std::uint32_t stream, std::uint32_t number,
                    std::uint32_t exposure, std::optional<DrawnFlaw> flaw);
Frame draw_good_part(std::size_t family, std::uint64_t seed, std::uint32_t stream, std::uint32_t number,
                     std::uint32_t exposure = 0);

}  // namespace hord::lab
