// The mass that has to move between two HORDs. Over the common denominator S_a * S_b their difference is the integer
// d = a * S_b - b * S_a per bin (formats and ranges: emd_solver.h): a surplus where d > 0, a deficit where d < 0. Mass
// that both share in a bin is cancelled.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "algo/frame/hord.h"
#include "algo/frame/occupied_bins.h"
#include "algo/simd/aligned.h"
#include "algo/simd/isa.h"

namespace hord::algo {

// Limit of S_a * S_b, which bounds the mass of a side and a mass times a sum. Below it masses, their sums and the two
// products of d are std::int32_t without overflow. Else the products are std::int64_t < 2^40 and the masses doubles.
constexpr double kInt32MassLimit = 0x1p31;

constexpr std::size_t kPage = 4096;  // bytes

// The bins with surplus, or with deficit, in ascending order.
template <class Mass>
struct alignas(kAlignment) ResidualSide {
    int count = 0;
    alignas(kAlignment) std::array<Mass, kMaxBinCount + 16> mass{};  // integers; kernels write up to 16 past `count`
    alignas(16) std::array<std::uint8_t, kMaxBinCount + 16> bin{};
};

// Both sides of std::int32_t lie within one page: they are written as overlapping vectors, and a store across two pages
// takes as long as all the others.
template <class Mass>
struct alignas(kPage) Residual {
    static constexpr std::size_t kSurplus = 0, kDeficit = 1;
    std::array<ResidualSide<Mass>, 2> side;  // [kSurplus], [kDeficit]

    // The side that becomes the rows: the one with fewer bins; if tied, with the lower bins, then with the lower
    // masses. So d(a,b) and d(b,a) are the same problem and have the same bits. Neither side is empty.
    [[nodiscard]] std::size_t rows() const {
        const int more = side[kSurplus].count << 8 | side[kSurplus].bin[0],
                  less = side[kDeficit].count << 8 | side[kDeficit].bin[0];
        if (more == less) [[unlikely]]
            return rows_if_tied();  // only if shared mass was kept
        return less < more ? kDeficit : kSurplus;
    }

  private:
    [[nodiscard]] std::size_t rows_if_tied() const;
};

static_assert(sizeof(Residual<std::int32_t>) == kPage);

// Both sums are positive; bins <= kMaxBinCount.
template <class Mass>
void find_residual(const Hord& a, const Hord& b, int bins, Residual<Mass>& residual);

// The kernel for S_a * S_b < kInt32MassLimit: 1, 8 or 16 bins at once; the same integers.
template <class Mass>
using FindResidual = void (*)(const Hord& a, const Hord& b, int bins, Residual<Mass>& residual);
FindResidual<std::int32_t> find_residual_for(Isa isa);

// For a ground distance that is no metric, where shared mass may have to move: a * S_b against b * S_a.
template <class Mass>
void keep_shared(const Hord& a, const Hord& b, int bins, Residual<Mass>& residual);

}  // namespace hord::algo
