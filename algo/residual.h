// What has to move between two HORDs: over the common denominator S_a * S_b their difference is d = a * S_b - b * S_a, an integer a bin
// (formats and ranges: emd.h). A bin has too much where d > 0, too little where d < 0; what both share bin by bin is gone.
#pragma once

#include <array>
#include <cstdint>

#include "algo/hord.h"
#include "algo/isa.h"
#include "algo/lit_bins.h"

namespace hord::algo {

// Masses on either side add up to less than this: they, and all their sums, are std::int32_t. Else they are doubles.
constexpr double kLightMass = 0x1p31;

// Bins that have too much, or too little, over the common denominator, in order.
template <class Mass>
struct ResidualSide {
    int count = 0;
    std::array<Mass, kMostBins + 8> mass{};  // integers; eight more: they are written before it is decided
    std::array<std::uint8_t, kMostBins + 8> bin{};
};

template <class Mass>
struct Residual {
    ResidualSide<Mass> more, less;

    // Which side becomes the rows: the one with fewer bins; of equals the one that comes first in bins, then in masses.
    // So d(a,b) and d(b,a) are the same problem, and equal to the last bit. Neither side is empty.
    [[nodiscard]] bool less_is_rows() const;
};

// Both HORDs have light. `bins` of them, at most kMostBins.
template <class Mass>
void find_residual(const Hord& a, const Hord& b, int bins, Residual<Mass>& residual);

// The fitting one for light masses: the same integers.
template <class Mass>
using FindResidual = void (*)(const Hord& a, const Hord& b, int bins, Residual<Mass>& residual);
FindResidual<std::int32_t> find_residual_for(Isa isa);

// Where shared mass may have to move, too, because the ground distance is no metric: a * S_b against b * S_a.
template <class Mass>
void keep_all(const Hord& a, const Hord& b, int bins, Residual<Mass>& residual);

}  // namespace hord::algo
