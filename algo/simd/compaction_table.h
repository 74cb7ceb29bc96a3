// For each set of eight, a bit each, its members in order: what closes up vectors where there is no instruction for it.
// For kernels' .cpp files only.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "algo/simd/multiversion.h"

#if defined(__x86_64__)
#include <immintrin.h>

namespace hord::algo {

inline constexpr auto kCompactionTable = [] {
    std::array<std::array<std::uint8_t, 8>, 256> members{};
    for (std::size_t set = 0; set < 256; ++set) {
        std::size_t count = 0;
        for (std::size_t k = 0; k < 8; ++k) {
            if ((set >> k & 1U) != 0) members[set][count++] = static_cast<std::uint8_t>(k);
        }
    }
    return members;
}();

// Eight bytes; those after the last member are 0.
[[gnu::target(HORD_AVX2)]] inline __m128i members(std::size_t set) {
    return _mm_loadl_epi64(reinterpret_cast<const __m128i*>(kCompactionTable[set].data()));
}

}  // namespace hord::algo
#endif
