// The set of bins of a HORD that hold light, as bits. Typically 7 of 81.
#pragma once

#include <algorithm>
#include <cstdint>

#if defined(__SSE2__)
#include <emmintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

#include "algo/frame/extents.h"

namespace hord::algo {

constexpr int kMaxBinCount = kMaxBins * kMaxBins;

class OccupiedBins {
  public:
    // Bins with light in either of two HORDs.
    OccupiedBins(const std::uint16_t* a, const std::uint16_t* b, int bins) : words_((bins + 63) / 64) {
        for (int w = 0; w < words_; ++w) word_[w] = word_of(a + w * 64, b + w * 64, std::min(bins - w * 64, 64), w > 0);
    }

    // Calls visit(bin) for each, in ascending order.
    template <class Visit>
    void for_each(Visit&& visit) const {
        for (int w = 0; w < words_; ++w) {
            for (std::uint64_t rest = word_[w]; rest != 0; rest &= rest - 1) visit(w * 64 + __builtin_ctzll(rest));
        }
    }

  private:
    // Sixteen bins at a time; the last sixteen overlap the previous ones.
    static std::uint64_t word_of(const std::uint16_t* a, const std::uint16_t* b, int count, bool more_before) {
        std::uint64_t bits = 0;
        int k = 0;
        for (; k + 16 <= count; k += 16) bits |= sixteen(a + k, b + k) << k;
        if (k == count) return bits;
        const int last = count - 16;
        if (last >= 0) return bits | sixteen(a + last, b + last) << last;
        if (more_before) return sixteen(a + last, b + last) >> -last;
        for (; k < count; ++k) bits |= std::uint64_t{(a[k] | b[k]) != 0} << k;
        return bits;
    }

    static std::uint64_t sixteen(const std::uint16_t* a, const std::uint16_t* b) {
#if defined(__SSE2__)
        const auto eight = [](const std::uint16_t* p, const std::uint16_t* q) {
            return _mm_cmpeq_epi16(_mm_or_si128(_mm_loadu_si128(reinterpret_cast<const __m128i*>(p)),
                                                _mm_loadu_si128(reinterpret_cast<const __m128i*>(q))),
                                   _mm_setzero_si128());
        };
        return static_cast<std::uint64_t>(_mm_movemask_epi8(_mm_packs_epi16(eight(a, b), eight(a + 8, b + 8)))) ^
            0xFFFFU;
#elif defined(__aarch64__)
        // Each lit lane becomes its bit; the sum of the lanes holds them all.
        const auto eight = [](const std::uint16_t* p, const std::uint16_t* q) {
            static constexpr std::uint16_t kBits[] = {1, 2, 4, 8, 16, 32, 64, 128};
            const uint16x8_t light = vorrq_u16(vld1q_u16(p), vld1q_u16(q));
            return std::uint64_t{vaddvq_u16(vandq_u16(vtstq_u16(light, light), vld1q_u16(kBits)))};
        };
        return eight(a, b) | eight(a + 8, b + 8) << 8;
#else
        std::uint64_t bits = 0;
        for (int k = 0; k < 16; ++k) bits |= std::uint64_t{(a[k] | b[k]) != 0} << k;
        return bits;
#endif
    }

    int words_;
    std::uint64_t word_[(kMaxBinCount + 63) / 64];
};

}  // namespace hord::algo
