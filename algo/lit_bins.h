// Which bins of a HORD hold light, as a set of bits: a HORD of 81 bins has 7 lit ones.
#pragma once

#include <algorithm>
#include <cstdint>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include "algo/light_field.h"

namespace hord::algo {

constexpr int kMostBins = kMaxBins * kMaxBins;

class LitBins {
  public:
    LitBins(const std::uint16_t* mass, int bins) : words_((bins + 63) / 64) {
        for (int w = 0; w < words_; ++w) {
            const std::uint16_t* const from = mass + w * 64;
            const int count = std::min(bins - w * 64, 64);
            std::uint64_t bits = 0;
            int k = 0;
            for (; k + 16 <= count; k += 16) bits |= sixteen(from + k) << k;
            for (; k < count; ++k) bits |= std::uint64_t{from[k] != 0} << k;
            word_[w] = bits;
        }
    }

    [[nodiscard]] int words() const { return words_; }
    [[nodiscard]] std::uint64_t word(int w) const { return word_[w]; }

  private:
    static std::uint64_t sixteen(const std::uint16_t* mass) {
#if defined(__SSE2__)
        const __m128i zero = _mm_setzero_si128();
        const __m128i low = _mm_cmpeq_epi16(_mm_loadu_si128(reinterpret_cast<const __m128i*>(mass)), zero);
        const __m128i high = _mm_cmpeq_epi16(_mm_loadu_si128(reinterpret_cast<const __m128i*>(mass + 8)), zero);
        return static_cast<std::uint64_t>(_mm_movemask_epi8(_mm_packs_epi16(low, high))) ^ 0xFFFFU;
#else
        std::uint64_t bits = 0;
        for (int k = 0; k < 16; ++k) bits |= std::uint64_t{mass[k] != 0} << k;
        return bits;
#endif
    }

    int words_;
    std::uint64_t word_[(kMostBins + 63) / 64];
};

}  // namespace hord::algo
