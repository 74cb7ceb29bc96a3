// The mean deflection of a HORD, in fixed point: where, relative to zero deflection, its light goes on average.
//
//     mean = sum over bins of r(i,j) * mass(i,j) / sum,    r(i,j) = (i - (I-1)/2, j - (J-1)/2)   (Eq. 12)
//
// Unit: bin pitches, positive to the right and downwards. The moments in half bins are exact integers of at most 14 * sum
// (algo/decode.h). One reciprocal serves both: floor(2^52 / sum), too small by less than 1; times a moment it stays
// below 14 * 2^52 < 2^56 and is wrong by less than the moment, 14 * 2^24. Shifted down by 29 bits to Q7.24 that is less than
// 0.44 of the last place, and rounding adds half of it: |mean| <= 7, error below 2^-24 bin (contract: 2^-12), proven
// against double in tests/algo/deflection_test.cpp. A mirrored HORD has exactly the negated deflection.
#pragma once

#include <span>

#include "algo/decode.h"
#include "algo/fixed.h"

namespace hord::algo {

using DeflectionQ = Q<7, 24>;

struct Deflection {
    DeflectionQ x;  // bin pitches
    DeflectionQ y;
    friend bool operator==(const Deflection&, const Deflection&) = default;
};

// sum > 0; |moments| <= 14 * sum, in half bins.
Deflection mean_deflection(std::uint32_t sum, std::int32_t moment_x, std::int32_t moment_y);

// One value a lenslet; zero where it is dark. A saturated lenslet's is a rough one: good enough to tell whether it shows
// free light (algo/rim.h), not to be compared with a neighbour's.
void mean_deflections(const HordRow& row, std::span<Deflection> out);

}  // namespace hord::algo
