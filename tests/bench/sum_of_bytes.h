// The fastest sum of bytes that we know: SAD instructions on x86-64. It is bound by memory.
#pragma once

#include <cstddef>
#include <cstdint>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace hord::bench {

inline std::uint64_t sum_of_bytes(const std::uint8_t* from, std::size_t count) {
    std::uint64_t sum = 0;
    std::size_t k = 0;
#if defined(__SSE2__)
    __m128i sums[4] = {};
    const auto* vectors = reinterpret_cast<const __m128i*>(from);
    for (; k + 64 <= count; k += 64, vectors += 4) {
        for (int v = 0; v < 4; ++v)
            sums[v] = _mm_add_epi64(sums[v], _mm_sad_epu8(_mm_loadu_si128(vectors + v), _mm_setzero_si128()));
    }
    for (const __m128i& s : sums)
        sum += static_cast<std::uint64_t>(_mm_cvtsi128_si64(s)) +
            static_cast<std::uint64_t>(_mm_cvtsi128_si64(_mm_srli_si128(s, 8)));
#endif
    for (; k < count; ++k) sum += from[k];
    return sum;
}

}  // namespace hord::bench
