// A HORD as integers: the bin masses and their sum, the common denominator of Eq. 8 (h = a / sum(a)).
//
// Nothing is divided: h(i,j) = mass[j*I + i] / sum, exactly. Masses are samples after dark subtraction.
// Range: a mass is at most 2^16 - 1 and there are at most 15 x 15 bins, so sum < 2^24.
#pragma once

#include <cstdint>

namespace hord::algo {

inline constexpr std::uint32_t kSumLimit = 1U << 24;  // above every sum; the ranges of the kernels rely on it

struct Hord {
    const std::uint16_t* mass = nullptr;  // I*J masses, j outer, i inner
    std::uint32_t sum = 0;                // of the masses; 0: no light, no HORD
};

}  // namespace hord::algo
