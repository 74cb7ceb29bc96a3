// Reasons why a lenslet has no valid value or is not judged. Bits combine.
#pragma once

#include <cstdint>

namespace hord::algo {

enum MaskBit : std::uint8_t {
    kValid = 0,
    kDark = 1,       // too little light for a HORD
    kSaturated = 2,  // a sample at full scale
    kBorder = 4,     // at the field's edge, or without a neighbour to compare with (algo/features/stencil.h)
    kRim = 8,        // the part's own rim: valid, but not judged
    kOutside = 16,   // outside the part, or outside the recipe's zones: valid, but not judged
    kAtLimit = 32,   // the value is a limit instead of a distance (algo/features/distance.h): valid
};

constexpr std::uint8_t kNoHord = kDark | kSaturated;     // the lenslet itself has no HORD
constexpr std::uint8_t kNoGradient = kNoHord | kBorder;  // it has no gradient over neighbours
constexpr std::uint8_t kNotJudged = kRim | kOutside;

}  // namespace hord::algo
