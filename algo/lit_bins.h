// Which bins of a HORD hold light, as a set of bits: a HORD of 81 bins has 7 lit ones.
#pragma once

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
        int k = 0;
#if defined(__SSE2__)
        const __m128i zero = _mm_setzero_si128();
        for (; k + 16 <= bins; k += 16) {
            const __m128i low = _mm_cmpeq_epi16(_mm_loadu_si128(reinterpret_cast<const __m128i*>(mass + k)), zero);
            const __m128i high = _mm_cmpeq_epi16(_mm_loadu_si128(reinterpret_cast<const __m128i*>(mass + k + 8)), zero);
            const auto dark = static_cast<std::uint64_t>(_mm_movemask_epi8(_mm_packs_epi16(low, high)));
            word_[k / 64] |= (dark ^ 0xFFFFU) << (k % 64);
        }
#endif
        for (; k < bins; ++k) word_[k / 64] |= std::uint64_t{mass[k] != 0} << (k % 64);
    }

    [[nodiscard]] int words() const { return words_; }
    [[nodiscard]] std::uint64_t word(int w) const { return word_[w]; }

  private:
    int words_;
    std::uint64_t word_[(kMostBins + 63) / 64] = {};
};

}  // namespace hord::algo
