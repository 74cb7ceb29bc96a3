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

}  // namespace

LanePlan plan_lanes(std::span<const std::int32_t> column, std::span<const std::int32_t> row,
                    std::span<const std::uint8_t> weights_x, int taps_x, int taps_y) {
    LanePlan plan;
    if (column.empty() || taps_x > LanePlan::kMaxTaps || taps_y > LanePlan::kMaxTaps) return plan;
    plan.rows = ((row.back() - row.front() + LanePlan::kPhases - 1) >> kPhaseBits) + 1 + LanePlan::kMaxTaps;
    if (plan.rows > LanePlan::kMaxRows) return plan;
    const auto bins = static_cast<int>(column.size());
    for (int phase = 0; phase < LanePlan::kPhases; ++phase) {
        LanePlan::Phase lanes;
        for (auto& shuffle : lanes.shuffle) shuffle.fill(0x80);  // 0
        for (auto& weight : lanes.weight) weight.fill(0);
        lanes.usable = true;
        const auto place = [&](int i) { return phase + column[static_cast<std::size_t>(i)] - column[0]; };
        if (bins > kHalf) lanes.second = place(kHalf) >> kPhaseBits;
        for (int i = 0; i < bins; ++i) {
            const int start = (place(i) >> kPhaseBits) - (i < kHalf ? 0 : lanes.second);
            if (start + taps_x > LanePlan::kWindow) return {};
            for (int tap = 0; tap < taps_x; ++tap) {
                const auto at = static_cast<std::size_t>(2 * i + tap % 2);
                const std::uint8_t weight =
                    weights_x[static_cast<std::size_t>((place(i) & (LanePlan::kPhases - 1)) * taps_x + tap)];
                lanes.usable = lanes.usable && weight < 128;
                lanes.shuffle[tap / 2][at] = static_cast<std::uint8_t>(start + tap);
                lanes.weight[tap / 2][at] = static_cast<std::int8_t>(weight);
            }
        }
        plan.phases.push_back(lanes);
    }
    return plan;
}

#if defined(__x86_64__)
namespace {

[[gnu::target("avx2")]] void decode_lanes_avx2(const LanesOf8Bit& lenslet, const LanePlan::Phase& phase,
                                               std::uint16_t* out, std::ptrdiff_t stride) {
    const auto vector = [](const auto& of) __attribute__((target("avx2"), always_inline)) {
        return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(of.data()));
    };
    const __m256i shuffle0 = vector(phase.shuffle[0]), shuffle1 = vector(phase.shuffle[1]);
    const __m256i weight0 = vector(phase.weight[0]), weight1 = vector(phase.weight[1]);
    const bool two_pairs = lenslet.taps_x > 2;
    const int rows =
        ((lenslet.place_y_fraction + lenslet.row.back() - lenslet.row.front()) >> kPhaseBits) + lenslet.taps_y;
    __m256i weighted[LanePlan::kMaxRows + 1];
    const std::byte* from = lenslet.first;
    for (int y = 0; y < rows; ++y, from += lenslet.row_bytes) {
        const __m128i low = _mm_loadu_si128(reinterpret_cast<const __m128i*>(from));
        const __m128i high = _mm_loadu_si128(reinterpret_cast<const __m128i*>(from + phase.second));
        const __m256i pixels = _mm256_inserti128_si256(_mm256_castsi128_si256(low), high, 1);
        __m256i sum = _mm256_maddubs_epi16(_mm256_shuffle_epi8(pixels, shuffle0), weight0);
        if (two_pairs)
            sum = _mm256_add_epi16(sum, _mm256_maddubs_epi16(_mm256_shuffle_epi8(pixels, shuffle1), weight1));
        weighted[y] = sum;
    }
    weighted[rows] = _mm256_setzero_si256();
    const __m256i half = _mm256_set1_epi32(1 << 13);
    for (const std::int32_t row : lenslet.row) {
        const int at = lenslet.place_y_fraction + row - lenslet.row.front();
        const __m256i* lines = weighted + (at >> kPhaseBits);
        const std::uint8_t* down = lenslet.weights_y + (at & (LanePlan::kPhases - 1)) * lenslet.taps_y;
        __m256i low = half, high = half;
        for (int tap = 0; tap < lenslet.taps_y; tap += 2) {
            const bool alone = tap + 1 == lenslet.taps_y;
            const __m256i one = lines[tap], two = alone ? _mm256_setzero_si256() : lines[tap + 1];
            const __m256i weights = _mm256_set1_epi32(down[tap] | (alone ? 0 : down[tap + 1] << 16));
            low = _mm256_add_epi32(low, _mm256_madd_epi16(_mm256_unpacklo_epi16(one, two), weights));
            high = _mm256_add_epi32(high, _mm256_madd_epi16(_mm256_unpackhi_epi16(one, two), weights));
        }
        const __m256i bins = _mm256_packus_epi32(_mm256_srli_epi32(low, 14), _mm256_srli_epi32(high, 14));
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(out), bins);
        out += stride;
    }
}

}  // namespace

DecodeLanes decode_lanes() { return best_isa() == Isa::avx2 ? decode_lanes_avx2 : nullptr; }
#else
DecodeLanes decode_lanes() { return nullptr; }
#endif

}  // namespace hord::algo
