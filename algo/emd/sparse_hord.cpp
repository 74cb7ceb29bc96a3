#include "algo/emd/sparse_hord.h"

#include "algo/emd/residual.h"
#include "algo/simd/compaction_table.h"
#include "algo/simd/multiversion.h"

namespace hord::algo {
namespace {

HORD_ALWAYS_INLINE void set_not_compacted(SparseHord& sparse, const std::uint16_t* masses, std::uint32_t sum) {
    sparse.masses = masses;
    sparse.sum = sum;
    sparse.compacted_sum = SparseHord::kNotCompacted;
}

void compact_none(const std::uint16_t* masses, std::span<const std::uint32_t> sums, int bins, SparseHord* to) {
    for (std::size_t l = 0; l < sums.size(); ++l, masses += bins) {
        set_not_compacted(to[l], masses, sums[l]);
    }
}
// Never called: subtract_none() finds no difference.
std::size_t unreachable_put(const SparseDifference& /*difference*/, TransportBatches<std::int32_t>& /*to*/) {
    __builtin_trap();
}
int subtract_none(const SparseHord& /*a*/, const SparseHord& /*b*/, SparseDifference& /*to*/) { return 0; }

#if defined(__x86_64__)
// The first lit bin, and all of them as bits from there on; 0 if there are none, too many or too far apart.
struct LitSpan {
    int first = 0;
    std::uint64_t lit = 0;
};

template <int Words>
HORD_ALWAYS_INLINE LitSpan span_of(const std::uint64_t (&word)[Words]) {
    int w = 0;
    while (w < Words && word[w] == 0) ++w;
    if (w == Words) return {};
    for (int k = w + 2; k < Words; ++k) {
        if (word[k] != 0) return {};
    }
    const int by = __builtin_ctzll(word[w]);
    const std::uint64_t next = w + 1 < Words ? word[w + 1] : 0;
    const std::uint64_t lit = word[w] >> by | next << 1 << (63 - by);
    if (next >> by != 0 || lit >> kMaxSparseSpan != 0 || __builtin_popcountll(lit) > kMaxSparseBins) return {};
    return {w * 64 + by, lit};
}

[[gnu::target(HORD_AVX2)]] inline std::uint64_t lit_of_sixteen(const std::uint16_t* mass) {
    const __m256i dark =
        _mm256_cmpeq_epi16(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(mass)), _mm256_setzero_si256());
    return static_cast<std::uint64_t>(
               _mm_movemask_epi8(_mm_packs_epi16(_mm256_castsi256_si128(dark), _mm256_extracti128_si256(dark, 1)))) ^
        0xFFFFU;
}

// Bit k of the words: bin k is lit. The last sixteen bins may overlap those before them.
template <int Words>
[[gnu::target(HORD_AVX2), gnu::always_inline]] inline void find_lit(const std::uint16_t* masses, int bins,
                                                                    std::uint64_t (&word)[Words]) {
    if (bins < 16) {
        word[0] = 0;
        for (int k = 0; k < bins; ++k) word[0] |= std::uint64_t{masses[k] != 0} << k;
        return;
    }
#pragma GCC unroll 4
    for (int w = 0; w < Words; ++w) {
        word[w] = 0;
#pragma GCC unroll 4
        for (int k = w * 64; k < w * 64 + 64; k += 16) {
            if (k >= bins) break;
            const int from = k + 16 <= bins ? k : bins - 16;
            word[w] |= lit_of_sixteen(masses + from) >> (k - from) << (k - w * 64);
        }
    }
}

template <int Words>
[[gnu::target(HORD_AVX2)]] void compact_words(const std::uint16_t* masses, std::span<const std::uint32_t> sums,
                                              int bins, SparseHord* to) {
    for (std::size_t l = 0; l < sums.size(); ++l, masses += bins) {
        SparseHord& sparse = to[l];
        set_not_compacted(sparse, masses, sums[l]);
        std::uint64_t word[Words];
        find_lit(masses, bins, word);
        const auto [first, lit] = span_of(word);
        if (lit == 0) continue;
        sparse.compacted_sum = sums[l];
        sparse.lit = lit;
        // Always kMaxSparseBins rounds, repeating the last lit bin: a constant count is faster.
        std::uint64_t rest = lit;
        for (std::size_t k = 0; k < kMaxSparseBins; ++k) {
            const int bin = first + __builtin_ctzll(rest);
            sparse.mass[k] = masses[bin];
            sparse.bin[k] = static_cast<std::uint8_t>(bin);
            const std::uint64_t others = rest & (rest - 1);
            rest = others != 0 ? others : rest;
        }
    }
}

[[gnu::target(HORD_AVX2)]] void compact_avx2(const std::uint16_t* masses, std::span<const std::uint32_t> sums, int bins,
                                             SparseHord* to) {
    if (bins <= 64) return compact_words<1>(masses, sums, bins, to);
    if (bins <= 128) return compact_words<2>(masses, sums, bins, to);
    compact_words<4>(masses, sums, bins, to);
}

alignas(kAlignment) constexpr auto kIota = [] {
    std::array<std::uint8_t, 64> iota{};
    for (std::size_t k = 0; k < iota.size(); ++k) iota[k] = static_cast<std::uint8_t>(k);
    return iota;
}();

// The same with compress instructions.
template <int Words>
[[gnu::target(HORD_AVX512)]] void compact_words_avx512(const std::uint16_t* masses, std::span<const std::uint32_t> sums,
                                                       int bins, SparseHord* to) {
    const __m512i iota = _mm512_load_si512(kIota.data());
    std::uint64_t there[Words];
    for (int w = 0; w < Words; ++w)
        there[w] = bins > w * 64 ? _bzhi_u64(~std::uint64_t{0}, static_cast<unsigned>(bins - w * 64)) : 0;
    for (std::size_t l = 0; l < sums.size(); ++l, masses += bins) {
        SparseHord& sparse = to[l];
        set_not_compacted(sparse, masses, sums[l]);
        std::uint64_t word[Words];
        for (int w = 0; w < Words; ++w) {
            const __m512i low = _mm512_maskz_loadu_epi16(static_cast<__mmask32>(there[w]), masses + w * 64);
            const __m512i high = _mm512_maskz_loadu_epi16(static_cast<__mmask32>(there[w] >> 32), masses + w * 64 + 32);
            word[w] = _mm512_test_epi16_mask(low, low) | std::uint64_t{_mm512_test_epi16_mask(high, high)} << 32;
        }
        const auto [first, lit] = span_of(word);
        if (lit == 0) continue;
        sparse.compacted_sum = sums[l];
        sparse.lit = lit;
        const auto low = static_cast<__mmask32>(lit), high = static_cast<__mmask32>(lit >> 32);
        const __m512i some = _mm512_maskz_compress_epi16(low, _mm512_maskz_loadu_epi16(low, masses + first));
        const __m512i others = _mm512_maskz_compress_epi16(high, _mm512_maskz_loadu_epi16(high, masses + first + 32));
        const auto behind = static_cast<__mmask8>(0xFFU << __builtin_popcount(low));
        const __m128i all = _mm_mask_expand_epi16(_mm512_castsi512_si128(some), behind, _mm512_castsi512_si128(others));
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(sparse.mass.data()), _mm256_cvtepu16_epi32(all));
        const __m512i bin =
            _mm512_maskz_compress_epi8(lit, _mm512_add_epi8(iota, _mm512_set1_epi8(static_cast<char>(first))));
        _mm_storel_epi64(reinterpret_cast<__m128i*>(sparse.bin.data()), _mm512_castsi512_si128(bin));
    }
}

[[gnu::target(HORD_AVX512)]] void compact_avx512(const std::uint16_t* masses, std::span<const std::uint32_t> sums,
                                                 int bins, SparseHord* to) {
    if (bins <= 64) return compact_words_avx512<1>(masses, sums, bins, to);
    if (bins <= 128) return compact_words_avx512<2>(masses, sums, bins, to);
    compact_words_avx512<4>(masses, sums, bins, to);
}

// Lookup table, the inverse of kCompactionTable: for each 8-bit mask and bit, the number of set bits below it, or -1 if
// the bit is not set.
alignas(kAlignment) constexpr auto kExpansionTable = [] {
    std::array<std::array<std::int8_t, 8>, 256> ranks{};
    for (std::size_t mask = 0; mask < 256; ++mask) {
        std::int8_t rank = 0;
        for (std::size_t k = 0; k < 8; ++k) ranks[mask][k] = (mask >> k & 1U) != 0 ? rank++ : std::int8_t{-1};
    }
    return ranks;
}();

[[gnu::target(HORD_AVX2)]] inline __m128i eight_bytes(const void* from) {
    return _mm_loadl_epi64(static_cast<const __m128i*>(from));
}

// Moves the bins and masses to the set bits of `mask`; 0 elsewhere.
struct Expanded {
    __m128i bin;
    __m256i mass;
};
[[gnu::target(HORD_AVX2), gnu::always_inline]] inline Expanded expand(const SparseHord& h, std::size_t mask) {
    const __m128i rank = eight_bytes(kExpansionTable[mask].data());
    const __m256i wide = _mm256_cvtepi8_epi32(rank);
    const __m256i mass =
        _mm256_permutevar8x32_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(h.mass.data())), wide);
    return {_mm_shuffle_epi8(eight_bytes(h.bin.data()), rank), _mm256_andnot_si256(_mm256_srai_epi32(wide, 31), mass)};
}

[[gnu::target(HORD_AVX2)]] int subtract(const SparseHord& a, const SparseHord& b, SparseDifference& to) {
    const int after = a.bin[0] - b.bin[0];
    const std::uint64_t in_a = a.lit << (after & ~(after >> 31) & 63), in_b = b.lit << (-after & (after >> 31) & 63),
                        in_either = in_a | in_b;
    const std::uint64_t denominator = std::uint64_t{a.compacted_sum} * b.compacted_sum;
    const int count = __builtin_popcountll(in_either);
    if (denominator >= static_cast<std::uint64_t>(kInt32MassLimit) || after > kMaxSparseShift ||
        after < -kMaxSparseShift || count > kMaxSparseBins)
        return 0;
    static_assert(kMaxSparseSpan + kMaxSparseShift <= 64);
    const Expanded of_a = expand(a, _pext_u64(in_a, in_either)), of_b = expand(b, _pext_u64(in_b, in_either));
    const __m256i has = _mm256_mullo_epi32(of_a.mass, _mm256_set1_epi32(static_cast<int>(b.compacted_sum)));
    const __m256i wants = _mm256_mullo_epi32(of_b.mass, _mm256_set1_epi32(static_cast<int>(a.compacted_sum)));
    _mm256_store_si256(reinterpret_cast<__m256i*>(to.excess), _mm256_sub_epi32(has, wants));
    _mm_storel_epi64(reinterpret_cast<__m128i*>(to.bin), _mm_or_si128(of_a.bin, of_b.bin));
    to.denominator = static_cast<std::int32_t>(denominator);
    return count;
}

// Chooses the rows as Residual::rows() does. Branch-free: branches would be unpredictable.
[[gnu::target(HORD_AVX2)]] std::size_t put(const SparseDifference& difference, TransportBatches<std::int32_t>& to) {
    const __m256i excess = _mm256_load_si256(reinterpret_cast<const __m256i*>(difference.excess));
    const __m256i mass[2] = {excess, _mm256_sub_epi32(_mm256_setzero_si256(), excess)};  // surplus, deficit
    const __m128i bin = eight_bytes(difference.bin);
    const auto negative = [](__m256i v) __attribute__((target(HORD_AVX2))) {
        return static_cast<unsigned>(_mm256_movemask_ps(_mm256_castsi256_ps(v)));
    };
    const unsigned set[2] = {negative(mass[1]), negative(mass[0])};
    *difference.out = 0;
    if (set[0] == 0) return 0;
    const auto rank = [](unsigned bins) __attribute__((target(HORD_AVX2))) {
        return static_cast<unsigned>(__builtin_popcount(bins)) << 8 | (bins & (0U - bins));
    };
    const unsigned deficit_is_rows = (rank(set[1]) - rank(set[0])) >> 31;
    const int counts[2] = {__builtin_popcount(set[0]), __builtin_popcount(set[1])};
    const std::size_t shape = to.shape(counts[deficit_is_rows], counts[1 - deficit_is_rows]);
    BatchedProblem<std::int32_t>& problem = to.add(shape);
    for (std::size_t side = 0; side < 2; ++side) {
        const __m128i which = compaction_indices(set[side]);
        const std::size_t as = side ^ deficit_is_rows;
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(problem.mass[as]),
                            _mm256_permutevar8x32_epi32(mass[side], _mm256_cvtepu8_epi32(which)));
        _mm_storel_epi64(reinterpret_cast<__m128i*>(problem.bin[as]), _mm_shuffle_epi8(bin, which));
    }
    problem.out = difference.out;
    *difference.out = difference.denominator;  // the divisor, until the batch is solved
    return shape;
}
#endif

}  // namespace

SparseKernels sparse_kernels([[maybe_unused]] Isa isa) {
#if defined(__x86_64__)
    if (isa == Isa::avx512) return {compact_avx512, subtract, put};
    if (isa == Isa::avx2) return {compact_avx2, subtract, put};
#endif
    return {compact_none, subtract_none, unreachable_put};
}

}  // namespace hord::algo
