#include "algo/emd/residual.h"

#include <algorithm>
#include <type_traits>

#include "algo/simd/compaction_table.h"
#include "algo/simd/multiversion.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace hord::algo {
namespace {

std::size_t index(int k) { return static_cast<std::size_t>(k); }

// The type of a mass times a sum: std::int32_t where S_a * S_b < kInt32MassLimit.
template <class Mass>
using Whole = std::conditional_t<std::is_same_v<Mass, std::int32_t>, std::int32_t, std::int64_t>;

template <class Mass>
void keep_side(const Hord& h, std::uint32_t other_sum, int bins, ResidualSide<Mass>& side) {
    side.count = 0;
    OccupiedBins(h.mass, h.mass, bins).for_each([&](int k) {
        side.mass[index(side.count)] = static_cast<Mass>(Whole<Mass>{h.mass[k]} * static_cast<Whole<Mass>>(other_sum));
        side.bin[index(side.count)] = static_cast<std::uint8_t>(k);
        ++side.count;
    });
}

}  // namespace

template <class Mass>
std::size_t Residual<Mass>::rows_if_tied() const {
    const ResidualSide<Mass>&surplus = side[kSurplus], &deficit = side[kDeficit];
    const auto end = surplus.bin.begin() + surplus.count;
    const auto [bin_surplus, bin_deficit] = std::mismatch(surplus.bin.begin(), end, deficit.bin.begin());
    const bool deficit_first = bin_surplus != end
        ? *bin_deficit < *bin_surplus
        : std::lexicographical_compare(deficit.mass.begin(), deficit.mass.begin() + deficit.count, surplus.mass.begin(),
                                       surplus.mass.begin() + surplus.count);
    return deficit_first ? kDeficit : kSurplus;
}

// One bin at a time. Branch-free: branches on the data would be unpredictable.
template <class Mass>
void find_residual(const Hord& a, const Hord& b, int bins, Residual<Mass>& residual) {
    const std::uint16_t* const mass_a = a.mass;
    const std::uint16_t* const mass_b = b.mass;
    const auto sum_a = static_cast<Whole<Mass>>(a.sum);
    const auto sum_b = static_cast<Whole<Mass>>(b.sum);
    auto& surplus = residual.side[residual.kSurplus];
    auto& deficit = residual.side[residual.kDeficit];
    std::size_t n_surplus = 0, n_deficit = 0;
    OccupiedBins(mass_a, mass_b, bins).for_each([&](int k) {
        const Whole<Mass> d = Whole<Mass>{mass_a[k]} * sum_b - Whole<Mass>{mass_b[k]} * sum_a;
        surplus.mass[n_surplus] = static_cast<Mass>(d);
        surplus.bin[n_surplus] = static_cast<std::uint8_t>(k);
        n_surplus += d > 0 ? 1U : 0U;
        deficit.mass[n_deficit] = static_cast<Mass>(-d);
        deficit.bin[n_deficit] = static_cast<std::uint8_t>(k);
        n_deficit += d < 0 ? 1U : 0U;
    });
    surplus.count = static_cast<int>(n_surplus);
    deficit.count = static_cast<int>(n_deficit);
}

template <class Mass>
void keep_shared(const Hord& a, const Hord& b, int bins, Residual<Mass>& residual) {
    keep_side(a, b.sum, bins, residual.side[residual.kSurplus]);
    keep_side(b, a.sum, bins, residual.side[residual.kDeficit]);
}

#if defined(__x86_64__)
namespace {

[[gnu::target(HORD_AVX2)]] inline __m256i eight(const Hord& h, int first) {
    return _mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(h.mass + first)));
}

[[gnu::target(HORD_AVX2)]] inline std::size_t negative(__m256i eight) {
    return static_cast<unsigned>(_mm256_movemask_ps(_mm256_castsi256_ps(eight)));
}

struct SideWriter {
    std::int32_t* mass;
    std::uint8_t* bin;
    std::size_t count = 0;
};

[[gnu::target(HORD_AVX2)]] inline void add(SideWriter& side, std::size_t mask, __m256i mass, __m128i first) {
    const __m128i indices = compaction_indices(mask);
    const __m256i packed = _mm256_permutevar8x32_epi32(mass, _mm256_cvtepu8_epi32(indices));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(side.mass + side.count), packed);
    _mm_storel_epi64(reinterpret_cast<__m128i*>(side.bin + side.count), _mm_add_epi8(indices, first));
    side.count += static_cast<std::size_t>(__builtin_popcountll(mask));
}

// Adds the differences `d` of eight bins from `first` on; skips the first `before`, which were added already.
[[gnu::target(HORD_AVX2)]] inline void add_eight(__m256i d, int first, int before, SideWriter& surplus,
                                                 SideWriter& deficit) {
    const __m256i minus_d = _mm256_sub_epi32(_mm256_setzero_si256(), d);
    const __m128i bin = _mm_set1_epi8(static_cast<char>(first));
    add(surplus, negative(minus_d) >> before << before, d, bin);
    add(deficit, negative(d) >> before << before, minus_d, bin);
}

[[gnu::target(HORD_AVX2)]] inline __m256i difference(const Hord& a, const Hord& b, int first) {
    return _mm256_sub_epi32(_mm256_mullo_epi32(eight(a, first), _mm256_set1_epi32(static_cast<int>(b.sum))),
                            _mm256_mullo_epi32(eight(b, first), _mm256_set1_epi32(static_cast<int>(a.sum))));
}

// Below it sums and masses fit std::int16_t: one madd instruction computes d of a bin.
constexpr std::uint32_t kNarrowSum = 1U << 15;

// Eight bins at once.
[[gnu::target(HORD_AVX2)]] void find_residual_avx2(const Hord& of_a, const Hord& of_b, int bins,
                                                   Residual<std::int32_t>& residual) {
    const Hord a = of_a, b = of_b;
    auto& [surplus_side, deficit_side] = residual.side;
    SideWriter surplus{surplus_side.mass.data(), surplus_side.bin.data()},
        deficit{deficit_side.mass.data(), deficit_side.bin.data()};
    const bool narrow = (a.sum | b.sum) < kNarrowSum;
    const __m256i factors = _mm256_set1_epi32(static_cast<int>(b.sum | (0U - a.sum) << 16));  // S_b, -S_a
    int k = 0;
    for (; k + 16 <= bins; k += 16) {
        const __m256i in_a = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(a.mass + k)),
                      in_b = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(b.mass + k));
        const __m256i either = _mm256_or_si256(in_a, in_b);
        if (_mm256_testz_si256(either, either) != 0)
            continue;  // well predicted: neighbours are mostly dark in the same bins
        if (narrow) [[likely]] {
            // unpacklo/hi interleave within 128-bit halves: swapping the middle quarters keeps the bins in order.
            const __m256i quarters_a = _mm256_permute4x64_epi64(in_a, 0b11011000),
                          quarters_b = _mm256_permute4x64_epi64(in_b, 0b11011000);
            add_eight(_mm256_madd_epi16(_mm256_unpacklo_epi16(quarters_a, quarters_b), factors), k, 0, surplus,
                      deficit);
            add_eight(_mm256_madd_epi16(_mm256_unpackhi_epi16(quarters_a, quarters_b), factors), k + 8, 0, surplus,
                      deficit);
        } else {
            add_eight(difference(a, b, k), k, 0, surplus, deficit);
            add_eight(difference(a, b, k + 8), k + 8, 0, surplus, deficit);
        }
    }
    if (k + 8 <= bins) {
        add_eight(difference(a, b, k), k, 0, surplus, deficit);
        k += 8;
    }
    std::uint32_t rest = 0;
    for (int at = k; at < bins; ++at) rest |= a.mass[at] | b.mass[at];
    if (rest != 0) add_eight(difference(a, b, bins - 8), bins - 8, 8 - (bins - k), surplus, deficit);
    surplus_side.count = static_cast<int>(surplus.count);
    deficit_side.count = static_cast<int>(deficit.count);
}

// Adds the bins of `mask` of sixteen. Always inlined: otherwise the sides would be passed through memory.
[[gnu::target(HORD_AVX512), gnu::always_inline]] inline void add_sixteen(SideWriter& side, __mmask16 mask, __m512i mass,
                                                                         __m128i bin) {
    _mm512_storeu_si512(side.mass + side.count, _mm512_maskz_compress_epi32(mask, mass));
    _mm_storeu_si128(reinterpret_cast<__m128i*>(side.bin + side.count), _mm_maskz_compress_epi8(mask, bin));
    side.count += static_cast<std::size_t>(__builtin_popcount(mask));
}

// Sixteen bins at once.
[[gnu::target(HORD_AVX512)]] void find_residual_avx512(const Hord& of_a, const Hord& of_b, int bins,
                                                       Residual<std::int32_t>& residual) {
    const Hord a = of_a, b = of_b;
    auto& [surplus_side, deficit_side] = residual.side;
    SideWriter surplus{surplus_side.mass.data(), surplus_side.bin.data()},
        deficit{deficit_side.mass.data(), deficit_side.bin.data()};
    const bool narrow = (a.sum | b.sum) < kNarrowSum;
    const __m512i factors = _mm512_set1_epi32(static_cast<int>(b.sum | (0U - a.sum) << 16));  // S_b, -S_a
    const __m512i sum_a = _mm512_set1_epi32(static_cast<int>(a.sum)),
                  sum_b = _mm512_set1_epi32(static_cast<int>(b.sum));
    const __m128i iota = _mm_setr_epi8(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    for (int k = 0; k < bins; k += 16) {
        const auto there = static_cast<__mmask16>(_bzhi_u32(0xFFFF, static_cast<unsigned>(bins - k)));
        const __m256i in_a = _mm256_maskz_loadu_epi16(there, a.mass + k),
                      in_b = _mm256_maskz_loadu_epi16(there, b.mass + k);
        const __m256i either = _mm256_or_si256(in_a, in_b);
        if (_mm256_testz_si256(either, either) != 0)
            continue;  // well predicted: neighbours are mostly dark in the same bins
        const __m512i wide_a = _mm512_cvtepu16_epi32(in_a), wide_b = _mm512_cvtepu16_epi32(in_b);
        const __m512i d = narrow
            ? _mm512_madd_epi16(_mm512_or_si512(wide_a, _mm512_slli_epi32(wide_b, 16)), factors)
            : _mm512_sub_epi32(_mm512_mullo_epi32(wide_a, sum_b), _mm512_mullo_epi32(wide_b, sum_a));
        const __m512i minus_d = _mm512_sub_epi32(_mm512_setzero_si512(), d);
        const __m128i bin = _mm_add_epi8(iota, _mm_set1_epi8(static_cast<char>(k)));
        add_sixteen(surplus, _mm512_movepi32_mask(minus_d), d, bin);
        add_sixteen(deficit, _mm512_movepi32_mask(d), minus_d, bin);
    }
    surplus_side.count = static_cast<int>(surplus.count);
    deficit_side.count = static_cast<int>(deficit.count);
}

}  // namespace
#endif

FindResidual<std::int32_t> find_residual_for([[maybe_unused]] Isa isa) {
#if defined(__x86_64__)
    if (isa == Isa::avx512) return find_residual_avx512;
    if (isa == Isa::avx2) return find_residual_avx2;
#endif
    return find_residual<std::int32_t>;
}

template struct Residual<std::int32_t>;
template struct Residual<double>;
template void find_residual(const Hord&, const Hord&, int, Residual<std::int32_t>&);
template void find_residual(const Hord&, const Hord&, int, Residual<double>&);
template void keep_shared(const Hord&, const Hord&, int, Residual<std::int32_t>&);
template void keep_shared(const Hord&, const Hord&, int, Residual<double>&);

}  // namespace hord::algo
