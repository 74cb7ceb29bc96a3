#include "algo/frame/resample_avx2.h"

#include <algorithm>

#include "algo/simd/isa.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace hord::algo {
namespace {

constexpr int kPhaseBits = 5;
constexpr int kHalf = 8;  // bins a window
constexpr int kMaxRowPhaseTaps = 3;

int taps_used(std::span<const std::uint8_t> weights) {
    return static_cast<int>(std::ranges::count_if(weights, [](std::uint8_t weight) { return weight != 0; }));
}

LanePlan::RowPhase row_phase(std::span<const std::uint8_t> weights) {
    LanePlan::RowPhase phase;
    phase.base = static_cast<std::uint8_t>(std::ranges::max_element(weights) - weights.begin());
    phase.other[0] = phase.other[1] = phase.base;
    std::size_t others = 0;
    for (std::size_t tap = 0; tap < weights.size(); ++tap) {
        if (weights[tap] == 0 || tap == phase.base) continue;
        phase.other[others] = static_cast<std::uint8_t>(tap);
        phase.factor[others] = static_cast<std::int16_t>(-512 * weights[tap]);
        phase.weight[others++] = static_cast<std::int16_t>(-weights[tap]);
    }
    return phase;
}

}  // namespace

LanePlan plan_lanes(std::span<const std::int32_t> column, std::span<const std::int32_t> row,
                    std::span<const std::uint8_t> weights_x, std::span<const std::uint8_t> weights_y, int taps_x,
                    int taps_y) {
    LanePlan plan;
    if (column.empty() || taps_x > LanePlan::kMaxTaps || taps_y > LanePlan::kMaxTaps) return plan;
    plan.rows = ((row.back() - row.front() + LanePlan::kPhases - 1) >> kPhaseBits) + 1 + LanePlan::kMaxTaps;
    if (plan.rows > LanePlan::kMaxRows) return plan;
    const auto bins = static_cast<int>(column.size());
    for (int phase = 0; phase < LanePlan::kPhases; ++phase) {
        LanePlan::Phase lanes;
        for (auto& shuffle : lanes.shuffle) shuffle.fill(0x80);  // 0
        for (auto& weight : lanes.weight) weight.fill(0);
        const auto place = [&](int i) { return phase + column[static_cast<std::size_t>(i)] - column[0]; };
        if (bins > kHalf) lanes.second = place(kHalf) >> kPhaseBits;
        for (int i = 0; i < bins; ++i) {
            const int start = (place(i) >> kPhaseBits) - (i < kHalf ? 0 : lanes.second);
            if (start + taps_x > LanePlan::kWindow) return {};
            for (int tap = 0; tap < taps_x; ++tap) {
                const auto at = static_cast<std::size_t>(2 * i + tap % 2);
                const std::uint8_t weight =
                    weights_x[static_cast<std::size_t>((place(i) & (LanePlan::kPhases - 1)) * taps_x + tap)];
                plan.two_pairs = plan.two_pairs || (tap > 1 && weight > 0);
                // 128 does not fit a signed byte: both bytes of the pair read the tap, with half of it.
                const bool alone = weight == 128;
                if (weight == 0) continue;
                for (const std::size_t byte : {at, alone ? at ^ 1U : at}) {
                    lanes.shuffle[tap / 2][byte] = static_cast<std::uint8_t>(start + tap);
                    lanes.weight[tap / 2][byte] = static_cast<std::int8_t>(alone ? 64 : weight);
                }
            }
        }
        plan.phases.push_back(lanes);
        const auto of_row =
            weights_y.subspan(static_cast<std::size_t>(phase * taps_y), static_cast<std::size_t>(taps_y));
        plan.row_taps = std::max(plan.row_taps, taps_used(of_row));
        if (taps_used(of_row) <= kMaxRowPhaseTaps) plan.row_phases[static_cast<std::size_t>(phase)] = row_phase(of_row);
    }
    return plan;
}

#if defined(__x86_64__)
namespace {

// A row of bins as 16-bit words 0..255 from `lines`, raw rows of which each word is the sum of weighted taps + 64.
[[gnu::target("avx2"), gnu::always_inline]] inline __m256i by_products(const __m256i* lines,
                                                                       const std::uint8_t* weights, int taps) {
    __m256i low = _mm256_setzero_si256(), high = low;
    for (int tap = 0; tap < taps; tap += 2) {
        const bool alone = tap + 1 == taps;
        const __m256i one = lines[tap], two = alone ? _mm256_setzero_si256() : lines[tap + 1];
        const __m256i pair = _mm256_set1_epi32(weights[tap] | (alone ? 0 : weights[tap + 1] << 16));
        low = _mm256_add_epi32(low, _mm256_madd_epi16(_mm256_unpacklo_epi16(one, two), pair));
        high = _mm256_add_epi32(high, _mm256_madd_epi16(_mm256_unpackhi_epi16(one, two), pair));
    }
    return _mm256_packus_epi32(_mm256_srli_epi32(low, 14), _mm256_srli_epi32(high, 14));
}

// The same by differences, of at most two or three taps. A product of 2^22 is taken apart into its upper part, product
// / 128 rounded down, and the 7 bits below it, whose sum may carry.
template <int Taps>
[[gnu::target("avx2"), gnu::always_inline]] inline __m256i by_differences(const __m256i* lines,
                                                                          const LanePlan::RowPhase& down) {
    const __m256i base = lines[down.base], first = _mm256_sub_epi16(base, lines[down.other[0]]);
    __m256i sum = _mm256_add_epi16(base, _mm256_mulhi_epi16(first, _mm256_set1_epi16(down.factor[0])));
    if constexpr (Taps > 2) {
        const __m256i below = _mm256_set1_epi16(127), second = _mm256_sub_epi16(base, lines[down.other[1]]);
        sum = _mm256_add_epi16(sum, _mm256_mulhi_epi16(second, _mm256_set1_epi16(down.factor[1])));
        const __m256i a = _mm256_mullo_epi16(first, _mm256_set1_epi16(down.weight[0])),
                      b = _mm256_mullo_epi16(second, _mm256_set1_epi16(down.weight[1]));
        const __m256i carry = _mm256_add_epi16(_mm256_and_si256(a, below), _mm256_and_si256(b, below));
        sum = _mm256_add_epi16(sum, _mm256_srli_epi16(carry, 7));
    }
    return _mm256_srli_epi16(sum, 7);
}

// RowTaps: 2, 3, or 4 for any number. TwoPairs: of taps along x.
template <int RowTaps, bool TwoPairs>
[[gnu::target("avx2")]] void decode_lanes_avx2(const LanesOf8Bit& lenslet, const LanePlan::Phase& phase,
                                               std::uint8_t* out, std::ptrdiff_t stride) {
    const auto vector = [](const auto& of) __attribute__((target("avx2"), always_inline)) {
        return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(of.data()));
    };
    const __m256i shuffle0 = vector(phase.shuffle[0]), shuffle1 = vector(phase.shuffle[1]);
    const __m256i weight0 = vector(phase.weight[0]), weight1 = vector(phase.weight[1]);
    const int rows =
        ((lenslet.place_y_fraction + lenslet.row.back() - lenslet.row.front()) >> kPhaseBits) + lenslet.taps_y;
    __m256i weighted[LanePlan::kMaxRows];
    const __m256i half = _mm256_set1_epi16(64);
    const std::byte* from = lenslet.first;
    for (int y = 0; y < rows; ++y, from += lenslet.row_bytes) {
        // Of the next row of lenslets: each line is another page, and the processor's own prefetch does not keep up.
        __builtin_prefetch(from + rows * lenslet.row_bytes);
        const __m128i low = _mm_loadu_si128(reinterpret_cast<const __m128i*>(from));
        const __m128i high = _mm_loadu_si128(reinterpret_cast<const __m128i*>(from + phase.second));
        const __m256i pixels = _mm256_inserti128_si256(_mm256_castsi128_si256(low), high, 1);
        __m256i sum = _mm256_add_epi16(half, _mm256_maddubs_epi16(_mm256_shuffle_epi8(pixels, shuffle0), weight0));
        if constexpr (TwoPairs)
            sum = _mm256_add_epi16(sum, _mm256_maddubs_epi16(_mm256_shuffle_epi8(pixels, shuffle1), weight1));
        weighted[y] = sum;
    }
    for (const std::int32_t row : lenslet.row) {
        const int at = lenslet.place_y_fraction + row - lenslet.row.front();
        const __m256i* lines = weighted + (at >> kPhaseBits);
        const auto row_phase = static_cast<std::size_t>(at & (LanePlan::kPhases - 1));
        __m256i words;
        if constexpr (RowTaps <= kMaxRowPhaseTaps)
            words = by_differences<RowTaps>(lines, lenslet.row_phases[row_phase]);
        else
            words = by_products(lines, lenslet.weights_y + row_phase * static_cast<std::size_t>(lenslet.taps_y),
                                lenslet.taps_y);
        const __m256i bytes = _mm256_permute4x64_epi64(_mm256_packus_epi16(words, words), 0b1000);
        _mm_storeu_si128(reinterpret_cast<__m128i*>(out), _mm256_castsi256_si128(bytes));
        out += stride;
    }
}

template <bool TwoPairs>
DecodeLanes kernel_for(int row_taps) {
    return row_taps <= 2 ? decode_lanes_avx2<2, TwoPairs>
        : row_taps == 3  ? decode_lanes_avx2<3, TwoPairs>
                         : decode_lanes_avx2<4, TwoPairs>;
}

}  // namespace

DecodeLanes decode_lanes(const LanePlan& plan) {
    if (plan.phases.empty() || best_isa() != Isa::avx2) return nullptr;
    return plan.two_pairs ? kernel_for<true>(plan.row_taps) : kernel_for<false>(plan.row_taps);
}
#else
DecodeLanes decode_lanes(const LanePlan&) { return nullptr; }
#endif

}  // namespace hord::algo
