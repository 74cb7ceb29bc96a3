// Lookup table: for each 8-bit mask, the indices of its set bits (left-packing without AVX-512). Include in kernels'
// .cpp files only.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "algo/simd/multiversion.h"

#if defined(__x86_64__)
#include <immintrin.h>

namespace hord::algo {

inline constexpr auto kCompactionTable = [] {
    std::array<std::array<std::uint8_t, 8>, 256> indices{};
    for (std::size_t mask = 0; mask < 256; ++mask) {
        std::size_t count = 0;
        for (std::size_t k = 0; k < 8; ++k) {
            if ((mask >> k & 1U) != 0) indices[mask][count++] = static_cast<std::uint8_t>(k);
        }
    }
    return indices;
}();

// Eight bytes: the indices of the set bits in ascending order, then zeros.
[[gnu::target(HORD_AVX2)]] inline __m128i compaction_indices(std::size_t mask) {
    return _mm_loadl_epi64(reinterpret_cast<const __m128i*>(kCompactionTable[mask].data()));
}

}  // namespace hord::algo
#endif
