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

// A mass times a sum is at most S_a * S_b: where that is light, both factors and the product are std::int32_t.
template <class Mass>
using Whole = std::conditional_t<std::is_same_v<Mass, std::int32_t>, std::int32_t, std::int64_t>;

template <class Mass>
void keep(const Hord& h, std::uint32_t other_sum, int bins, ResidualSide<Mass>& side) {
    const OccupiedBins lit(h.mass, bins);
    side.count = 0;
    for (int w = 0; w < lit.words(); ++w) {
        for (std::uint64_t rest = lit.word(w); rest != 0; rest &= rest - 1) {
            const int k = w * 64 + __builtin_ctzll(rest);
            side.mass[index(side.count)] =
                static_cast<Mass>(Whole<Mass>{h.mass[k]} * static_cast<Whole<Mass>>(other_sum));
            side.bin[index(side.count)] = static_cast<std::uint8_t>(k);
            ++side.count;
        }
    }
}

}  // namespace

template <class Mass>
std::size_t Residual<Mass>::rows_of_alike() const {
    const ResidualSide<Mass>&more = side[kMore], &less = side[kLess];
    const auto end = more.bin.begin() + more.count;
    const auto [of_more, of_less] = std::mismatch(more.bin.begin(), end, less.bin.begin());
    const bool less_first = of_more != end
        ? *of_less < *of_more
        : std::lexicographical_compare(less.mass.begin(), less.mass.begin() + less.count, more.mass.begin(),
                                       more.mass.begin() + more.count);
    return less_first ? kLess : kMore;
}

// One bin after the other: no branches on the data, they would be guesses.
template <class Mass>
void find_residual(const Hord& a, const Hord& b, int bins, Residual<Mass>& residual) {
    const std::uint16_t* const mass_a = a.mass;
    const std::uint16_t* const mass_b = b.mass;
    const auto sum_a = static_cast<Whole<Mass>>(a.sum);
    const auto sum_b = static_cast<Whole<Mass>>(b.sum);
    auto& [more, less] = residual.side;
    std::size_t n_more = 0, n_less = 0;
    const OccupiedBins lit(mass_a, mass_b, bins);
    for (int w = 0; w < lit.words(); ++w) {
        for (std::uint64_t rest = lit.word(w); rest != 0; rest &= rest - 1) {
            const int k = w * 64 + __builtin_ctzll(rest);
            const Whole<Mass> d = Whole<Mass>{mass_a[k]} * sum_b - Whole<Mass>{mass_b[k]} * sum_a;
            more.mass[n_more] = static_cast<Mass>(d);
            more.bin[n_more] = static_cast<std::uint8_t>(k);
            n_more += d > 0 ? 1U : 0U;
            less.mass[n_less] = static_cast<Mass>(-d);
            less.bin[n_less] = static_cast<std::uint8_t>(k);
            n_less += d < 0 ? 1U : 0U;
        }
    }
    more.count = static_cast<int>(n_more);
    less.count = static_cast<int>(n_less);
}

template <class Mass>
void keep_all(const Hord& a, const Hord& b, int bins, Residual<Mass>& residual) {
    keep(a, b.sum, bins, residual.side[residual.kMore]);
    keep(b, a.sum, bins, residual.side[residual.kLess]);
}

#if defined(__x86_64__)
namespace {

[[gnu::target(HORD_AVX2)]] inline __m256i eight(const Hord& h, int first) {
    return _mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(h.mass + first)));
}

[[gnu::target(HORD_AVX2)]] inline std::size_t negative(__m256i eight) {
    return static_cast<unsigned>(_mm256_movemask_ps(_mm256_castsi256_ps(eight)));
}

// One side, as it grows.
struct Side {
    std::int32_t* mass;
    std::uint8_t* bin;
    std::size_t count = 0;
};

[[gnu::target(HORD_AVX2)]] inline void add(Side& side, std::size_t set, __m256i mass, __m128i first) {
    const __m128i which = compaction_indices(set);
    const __m256i closed_up = _mm256_permutevar8x32_epi32(mass, _mm256_cvtepu8_epi32(which));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(side.mass + side.count), closed_up);
    _mm_storel_epi64(reinterpret_cast<__m128i*>(side.bin + side.count), _mm_add_epi8(which, first));
    side.count += static_cast<std::size_t>(__builtin_popcountll(set));
}

// Differences of eight bins from `first` on, of which the first few were there before.
[[gnu::target(HORD_AVX2)]] inline void add_eight(__m256i more, int first, int before, Side& has_more, Side& has_less) {
    const __m256i less = _mm256_sub_epi32(_mm256_setzero_si256(), more);
    const __m128i bin = _mm_set1_epi8(static_cast<char>(first));
    add(has_more, negative(less) >> before << before, more, bin);
    add(has_less, negative(more) >> before << before, less, bin);
}

[[gnu::target(HORD_AVX2)]] inline __m256i difference(const Hord& a, const Hord& b, int first) {
    return _mm256_sub_epi32(_mm256_mullo_epi32(eight(a, first), _mm256_set1_epi32(static_cast<int>(b.sum))),
                            _mm256_mullo_epi32(eight(b, first), _mm256_set1_epi32(static_cast<int>(a.sum))));
}

// Below it sums, and so masses, are 16 bits with a sign: both products of a bin and their difference are one
// instruction.
constexpr std::uint32_t kNarrowSum = 1U << 15;

// The same integers, eight bins at once.
[[gnu::target(HORD_AVX2)]] void find_residual_avx2(const Hord& of_a, const Hord& of_b, int bins,
                                                   Residual<std::int32_t>& residual) {
    const Hord a = of_a, b = of_b;
    auto& [has_more, has_less] = residual.side;
    Side more{has_more.mass.data(), has_more.bin.data()}, less{has_less.mass.data(), has_less.bin.data()};
    const bool narrow = (a.sum | b.sum) < kNarrowSum;
    const __m256i factors = _mm256_set1_epi32(static_cast<int>(b.sum | (0U - a.sum) << 16));  // S_b, -S_a
    int k = 0;
    for (; k + 16 <= bins; k += 16) {
        const __m256i in_a = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(a.mass + k)),
                      in_b = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(b.mass + k));
        const __m256i either = _mm256_or_si256(in_a, in_b);
        if (_mm256_testz_si256(either, either) != 0)
            continue;  // neighbours mostly are dark in the same places: this is seldom a wrong guess
        if (narrow) [[likely]] {
            // Interleaving goes by halves of a vector: quarters are brought where it leaves bins in order.
            const __m256i quarters_a = _mm256_permute4x64_epi64(in_a, 0b11011000),
                          quarters_b = _mm256_permute4x64_epi64(in_b, 0b11011000);
            add_eight(_mm256_madd_epi16(_mm256_unpacklo_epi16(quarters_a, quarters_b), factors), k, 0, more, less);
            add_eight(_mm256_madd_epi16(_mm256_unpackhi_epi16(quarters_a, quarters_b), factors), k + 8, 0, more, less);
        } else {
            add_eight(difference(a, b, k), k, 0, more, less);
            add_eight(difference(a, b, k + 8), k + 8, 0, more, less);
        }
    }
    if (k + 8 <= bins) {
        add_eight(difference(a, b, k), k, 0, more, less);
        k += 8;
    }
    std::uint32_t rest = 0;
    for (int at = k; at < bins; ++at) rest |= a.mass[at] | b.mass[at];
    if (rest != 0) add_eight(difference(a, b, bins - 8), bins - 8, 8 - (bins - k), more, less);
    has_more.count = static_cast<int>(more.count);
    has_less.count = static_cast<int>(less.count);
}

// Sixteen bins, those of `set`. Always inlined: a function of its own would take the sides through memory.
[[gnu::target(HORD_AVX512), gnu::always_inline]] inline void add_sixteen(Side& side, __mmask16 set, __m512i mass,
                                                                         __m128i bin) {
    _mm512_storeu_si512(side.mass + side.count, _mm512_maskz_compress_epi32(set, mass));
    _mm_storeu_si128(reinterpret_cast<__m128i*>(side.bin + side.count), _mm_maskz_compress_epi8(set, bin));
    side.count += static_cast<std::size_t>(__builtin_popcount(set));
}

// The same integers, sixteen bins at once.
[[gnu::target(HORD_AVX512)]] void find_residual_avx512(const Hord& of_a, const Hord& of_b, int bins,
                                                       Residual<std::int32_t>& residual) {
    const Hord a = of_a, b = of_b;
    auto& [has_more, has_less] = residual.side;
    Side more{has_more.mass.data(), has_more.bin.data()}, less{has_less.mass.data(), has_less.bin.data()};
    const bool narrow = (a.sum | b.sum) < kNarrowSum;
    const __m512i factors = _mm512_set1_epi32(static_cast<int>(b.sum | (0U - a.sum) << 16));  // S_b, -S_a
    const __m512i sum_a = _mm512_set1_epi32(static_cast<int>(a.sum)),
                  sum_b = _mm512_set1_epi32(static_cast<int>(b.sum));
    const __m128i numbers = _mm_setr_epi8(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    for (int k = 0; k < bins; k += 16) {
        const auto there = static_cast<__mmask16>(_bzhi_u32(0xFFFF, static_cast<unsigned>(bins - k)));
        const __m256i in_a = _mm256_maskz_loadu_epi16(there, a.mass + k),
                      in_b = _mm256_maskz_loadu_epi16(there, b.mass + k);
        const __m256i either = _mm256_or_si256(in_a, in_b);
        if (_mm256_testz_si256(either, either) != 0)
            continue;  // neighbours mostly are dark in the same places: this is seldom a wrong guess
        const __m512i wide_a = _mm512_cvtepu16_epi32(in_a), wide_b = _mm512_cvtepu16_epi32(in_b);
        const __m512i has_too_much = narrow
            ? _mm512_madd_epi16(_mm512_or_si512(wide_a, _mm512_slli_epi32(wide_b, 16)), factors)
            : _mm512_sub_epi32(_mm512_mullo_epi32(wide_a, sum_b), _mm512_mullo_epi32(wide_b, sum_a));
        const __m512i has_too_little = _mm512_sub_epi32(_mm512_setzero_si512(), has_too_much);
        const __m128i bin = _mm_add_epi8(numbers, _mm_set1_epi8(static_cast<char>(k)));
        add_sixteen(more, _mm512_movepi32_mask(has_too_little), has_too_much, bin);
        add_sixteen(less, _mm512_movepi32_mask(has_too_much), has_too_little, bin);
    }
    has_more.count = static_cast<int>(more.count);
    has_less.count = static_cast<int>(less.count);
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
template void keep_all(const Hord&, const Hord&, int, Residual<std::int32_t>&);
template void keep_all(const Hord&, const Hord&, int, Residual<double>&);

}  // namespace hord::algo
