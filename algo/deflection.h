// The mean deflection of a HORD, in fixed point: where, relative to zero deflection, its light goes on average.
//
//     mean = sum over bins of r(i,j) * mass(i,j) / sum,    r(i,j) = (i - (I-1)/2, j - (J-1)/2)   (Eq. 12)
//
// Unit: bin pitches, positive to the right and downwards. r is counted in half bins, an integer of at most 14, so
// |sum of 2r * mass| <= 14 * 2^24 < 2^28 is exact in 32 bits. One reciprocal serves both components:
// floor(2^52 / sum), wrong by less than 1 in 2^52/sum; times a numerator of at most 14 * sum it stays below 2^56 and
// adds an error below 14 / 2^53 * sum < 14 / 2^29 bin. Result: Q7.24, |mean| <= 7, error below 2^-24 bin
// (contract: 2^-12); proven against double in tests/algo/deflection_test.cpp.
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

// hord.sum > 0 and equal to the sum of its masses.
Deflection mean_deflection(const Hord& hord, int bins_i, int bins_j);

// One value a lenslet; zero where it is dark. A saturated lenslet's is a rough one: good enough to tell whether it shows
// free light (algo/rim.h), not to be compared with a neighbour's.
void mean_deflections(const HordRow& row, const Extents& extents, std::span<Deflection> out);

}  // namespace hord::algo
