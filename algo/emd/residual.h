// What has to move between two HORDs: over the common denominator S_a * S_b their difference is d = a * S_b - b * S_a,
// an integer a bin (formats and ranges: emd_solver.h). A bin has too much where d > 0, too little where d < 0; what
// both share bin by bin is gone.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "algo/frame/hord.h"
#include "algo/frame/occupied_bins.h"
#include "algo/simd/aligned.h"
#include "algo/simd/isa.h"

namespace hord::algo {

// Masses on either side add up to less than this (S_a * S_b, which also bounds a mass times a sum): they, all their
// sums and the two products of d are std::int32_t, and nothing overflows. Else the products are std::int64_t, below
// 2^40, and the masses doubles.
constexpr double kLightMass = 0x1p31;

constexpr std::size_t kPage = 4096;  // bytes

// Bins that have too much, or too little, over the common denominator, in order.
template <class Mass>
struct alignas(kAlignment) ResidualSide {
    int count = 0;
    alignas(kAlignment)
        std::array<Mass, kMaxBinCount + 16> mass{};  // integers; sixteen more: they are written before it is decided
    alignas(16) std::array<std::uint8_t, kMaxBinCount + 16> bin{};
};

// Light masses of both sides lie within one page: they are written as vectors that overlap, and one that begins on a
// page and ends on the next takes as long as all the others. Heavy ones are written one by one.
template <class Mass>
struct alignas(kPage) Residual {
    static constexpr std::size_t kMore = 0, kLess = 1;
    std::array<ResidualSide<Mass>, 2> side;  // what has too much, what has too little

    // The side that becomes the rows: that with fewer bins; of equals the one that comes first in bins, then in masses.
    // So d(a,b) and d(b,a) are the same problem, and equal to the last bit. Neither side is empty.
    [[nodiscard]] std::size_t rows() const {
        const int more = side[kMore].count << 8 | side[kMore].bin[0],
                  less = side[kLess].count << 8 | side[kLess].bin[0];
        if (more == less) [[unlikely]]
            return rows_of_alike();  // never, where what both share is gone
        return less < more ? kLess : kMore;
    }

  private:
    [[nodiscard]] std::size_t rows_of_alike() const;
};

static_assert(sizeof(Residual<std::int32_t>) == kPage);

// Both HORDs have light. `bins` of them, at most kMaxBinCount.
template <class Mass>
void find_residual(const Hord& a, const Hord& b, int bins, Residual<Mass>& residual);

// For light masses, S_a * S_b < kLightMass: one bin after the other, eight or sixteen at once; the same integers.
template <class Mass>
using FindResidual = void (*)(const Hord& a, const Hord& b, int bins, Residual<Mass>& residual);
FindResidual<std::int32_t> find_residual_for(Isa isa);

// Where shared mass may have to move, too, because the ground distance is no metric: a * S_b against b * S_a.
template <class Mass>
void keep_all(const Hord& a, const Hord& b, int bins, Residual<Mass>& residual);

}  // namespace hord::algo
