// The mean deflection of a HORD in fixed point: the mean direction of its light relative to zero deflection.
//
//     mean = sum over bins of r(i,j) * mass(i,j) / sum,    r(i,j) = (i - (I-1)/2, j - (J-1)/2)   (Eq. 12)
//
// Unit: bin pitches, positive to the right and downwards, |mean| <= 7. Error < 2^-24 bin (docs/notes/features.md; test:
// tests/algo/features/deflection_test.cpp). A mirrored HORD has exactly the negated deflection. The same bits on every
// platform.
#pragma once

#include <span>

#include "algo/frame/decode.h"
#include "common/fixed.h"

namespace hord::algo {

using DeflectionQ = Q<7, 24>;

struct Deflection {
    DeflectionQ x;  // bin pitches
    DeflectionQ y;
    friend bool operator==(const Deflection&, const Deflection&) = default;
};

// moment / sum in half bins, as the raw value of a Q7.24 in bins; sum > 0. A compiler can vectorise loops over it.
constexpr std::int32_t quotient_q24(std::int32_t moment, std::uint32_t sum) {
    const double scaled = static_cast<double>(moment) * 0x1p23 / static_cast<double>(static_cast<std::int32_t>(sum));
    return static_cast<std::int32_t>(scaled + (moment < 0 ? -0.5 : 0.5));
}

// sum > 0, below 2^24; |moments| <= 14 * sum, in half bins.
Deflection mean_deflection(std::uint32_t sum, std::int32_t moment_x, std::int32_t moment_y);

// One value per lenslet; zero where it is dark. Saturated lenslets get an approximate value, which is good enough to
// find free light (algo/inspection/rim.h); it must not be compared with neighbours.
void mean_deflections(const HordRow& row, std::span<Deflection> out);

}  // namespace hord::algo
