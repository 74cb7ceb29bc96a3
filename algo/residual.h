// What has to move between two HORDs: over the common denominator S_a * S_b their difference is d = a * S_b - b * S_a, an integer a bin
// (formats and ranges: emd.h). A bin has too much where d > 0, too little where d < 0; what both share bin by bin is gone.
#pragma once

#include <array>
#include <cstdint>

#include "algo/hord.h"
#include "algo/lit_bins.h"

namespace hord::algo {

// Masses on either side add up to less than this: they, and all their sums, are std::int32_t.
constexpr double kLightMass = 0x1p31;

// Bins that have too much, or too little, over the common denominator, in order.
struct ResidualSide {
    int count = 0;
    std::array<double, kMostBins + 1> mass;  // integers; one more: a loop writes before it decides
    std::array<std::uint8_t, kMostBins + 1> bin;

    // Which side becomes the rows: the one with fewer bins; of equals the one that comes first in bins, then in masses.
    // So d(a,b) and d(b,a) are the same problem, and equal to the last bit.
    [[nodiscard]] bool precedes(const ResidualSide& other) const;
};

// Both HORDs have light. `bins` of them, at most kMostBins.
void find_residual(const Hord& a, const Hord& b, int bins, ResidualSide& more, ResidualSide& less);

// Where shared mass may have to move, too, because the ground distance is no metric: a * S_b against b * S_a.
void keep_all(const Hord& a, const Hord& b, int bins, ResidualSide& more, ResidualSide& less);

}  // namespace hord::algo
