#include "algo/reference/reference_sampler.h"

#include <cmath>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "algo/frame/mask.h"
#include "algo/reference/pose.h"
#include "algo/reference/reference_row_sampler.h"
#include "algo/simd/multiversion.h"

namespace hord::algo {

namespace {

constexpr int kLanes = 8, kLine = PlaceRange::kLine;

using Eight = Vector<float, kLanes * sizeof(float)>;
using EightInts = Vector<std::int32_t, kLanes * sizeof(std::int32_t)>;

// Eight shares at the part's light (docs/notes/reference.md); not below 0.
HORD_ALWAYS_INLINE Eight at_light(const Eight& share, float light, float clip) {
    const Eight nothing{};
    const Eight g = share > nothing ? share : nothing;
    const Eight seen = light * g - (1.0F - light) * (g < clip ? g : nothing + clip);
    return seen > nothing ? seen : nothing;
}
// Not by value: Clang refuses a vector that a function without AVX returns to one with it.
HORD_ALWAYS_INLINE void at_light(const EightInts& sum, float light, float clip, Eight& seen) {
    seen = at_light(__builtin_convertvector(sum, Eight) * 0x1p-29F, light, clip);
}
HORD_ALWAYS_INLINE float total(const Eight& lanes) {
    const auto pair = [&](int k) { return lanes[k] + lanes[k + 4]; };
    return (pair(0) + pair(1)) + (pair(2) + pair(3));
}

float gather_portable(const ReferenceSampler::Taps& taps, PlaceRange lines, float* __restrict out) {
    Eight all{};
    for (int k = lines.first; k < lines.end(); k += kLanes) {
        EightInts sum{};
        for (int t = 0; t < 16; ++t) {
            const std::uint16_t* at = taps.from[t] + k;
            const std::int32_t w = taps.weights[t];
            for (int l = 0; l < kLanes; ++l) sum[l] += w * at[l];
        }
        Eight seen;
        at_light(sum, taps.light, taps.clip, seen);
        store(seen, out + k);
        all += seen;
    }
    return total(all);
}

#if defined(__x86_64__)
// The same integers, two taps in one multiplication.
[[gnu::target("avx2")]] float gather_avx2(const ReferenceSampler::Taps& taps, PlaceRange lines, float* __restrict out) {
    const auto sixteen = [](const std::uint16_t* from) __attribute__((target("avx2"), always_inline)) {
        return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(from));
    };
    __m256i weights[8];
    for (int t = 0; t < 8; ++t) {
        std::int32_t two;
        std::memcpy(&two, taps.weights + std::ptrdiff_t{2} * t, sizeof two);
        weights[t] = _mm256_set1_epi32(two);
    }
    Eight all{};
    for (int k = lines.first; k < lines.end(); k += kLine) {
        __m256i even = _mm256_setzero_si256(), odd = even;
        for (int t = 0; t < 8; ++t) {
            const __m256i a = sixteen(taps.from[2 * t] + k), b = sixteen(taps.from[2 * t + 1] + k);
            even = _mm256_add_epi32(even, _mm256_madd_epi16(_mm256_unpacklo_epi16(a, b), weights[t]));
            odd = _mm256_add_epi32(odd, _mm256_madd_epi16(_mm256_unpackhi_epi16(a, b), weights[t]));
        }
        Eight first, second;
        at_light(reinterpret_cast<EightInts>(_mm256_permute2x128_si256(even, odd, 0x20)), taps.light, taps.clip, first);
        at_light(reinterpret_cast<EightInts>(_mm256_permute2x128_si256(even, odd, 0x31)), taps.light, taps.clip,
                 second);
        store(first, out + k);
        store(second, out + k + kLanes);
        all += first;
        all += second;
    }
    return total(all);
}
auto gather_for(Isa isa) { return isa == Isa::portable ? gather_portable : gather_avx2; }
#else
auto gather_for(Isa) { return gather_portable; }
#endif

}  // namespace

ReferenceSampler::ReferenceSampler(const Reference& reference, Isa isa)
    : reference_(reference), lit_(reference.extents.lenslets()), gather_(gather_for(isa)) {
    const auto stride = reference.stride(), pitch = static_cast<std::size_t>(reference.extents.i + 2);
    for (std::size_t k = 0; k < lit_.size(); ++k) {
        const std::uint16_t* share = reference.shares.data() + k * stride;
        for (std::size_t place = 0; place < stride; ++place) {
            if (share[place] == 0) continue;
            const auto column = static_cast<std::int16_t>(place % pitch - 1),
                       row = static_cast<std::int16_t>(place / pitch - 1), at = static_cast<std::int16_t>(place);
            lit_[k].cover({{column, column, row, row}, at, at});
        }
    }
}

ReferenceSampler::ReferenceHord ReferenceSampler::read(double m, double n, double light, float* bins) const {
    const Extents& e = reference_.extents;
    const std::size_t stride = reference_.stride();
    const int floor_m = floor_of(m), floor_n = floor_of(n);
    Taps taps;
    double sum = 0;
    std::uint8_t mask = 0;
    ReferenceHord reference_hord;
    const auto near = InterpolationWindow::of(
        m, n, e, [&](int x, int y) { return (reference_.mask[e.index(x, y)] & (kOutside | kDark)) == 0; });
    // With dark lenslets around: the light alone, by linear interpolation.
    const auto around = near.found ? near : InterpolationWindow::of(m, n, e, [&](int x, int y) {
        return (reference_.mask[e.index(x, y)] & kOutside) == 0;
    });
    if (!around.found) return reference_hord;
    const QuantisedCubic along = quantised(near.found ? around.along : CubicWeights::linear_at(m - floor_m)),
                         across = quantised(near.found ? around.across : CubicWeights::linear_at(n - floor_n));
    int count = 0;
    for (int r = 0; r < 4; ++r) {
        for (int c = 0; c < 4; ++c) {
            const int w = along.of[c] * across.of[r];
            if (w == 0) continue;
            const std::size_t k = e.index(around.m + c, around.n + r);
            mask |= reference_.mask[k];
            sum += w * static_cast<double>(reference_.light[k]);
            reference_hord.lit.cover(lit_[k]);
            taps.from[count] = reference_.shares.data() + k * stride;
            taps.weights[count++] = static_cast<std::int16_t>(w);
        }
    }
    for (int t = count; t < 16; ++t) taps.from[t] = reference_.shares.data(), taps.weights[t] = 0;
    if ((mask & kOutside) != 0) return reference_hord;
    reference_hord.has_light = true;
    reference_hord.light = sum * 0x1p-14;
    reference_hord.share = light;
    if ((mask & kDark) != 0 || !(reference_hord.light > 0) || reference_hord.lit.bins.none()) return reference_hord;
    taps.light = static_cast<float>(light);
    taps.clip = static_cast<float>(static_cast<double>(reference_.sensor.clip_dn) / reference_hord.light);
    const int lines = (reference_hord.lit.last - reference_hord.lit.first) / kLine + 1;
    reference_hord.written = {std::min(reference_hord.lit.first, static_cast<int>(stride) - lines * kLine), lines};
    reference_hord.share = static_cast<double>(gather_(taps, reference_hord.written, bins));
    reference_hord.has_hord = reference_hord.share > 0;
    return reference_hord;
}

}  // namespace hord::algo
