// Random numbers as a function of (seed, stream, index). No state: drawing one never shifts another. No libm: the same
// seed gives the same bits on every machine.
#pragma once

#include <cstdint>

namespace hord::sim {

// SplitMix64's output function (Steele, Lea, Flood 2014).
constexpr std::uint64_t mix64(std::uint64_t x) {
    x += 0x9E3779B97F4A7C15U;
    x = (x ^ (x >> 30U)) * 0xBF58476D1CE4E5B9U;
    x = (x ^ (x >> 27U)) * 0x94D049BB133111EBU;
    return x ^ (x >> 31U);
}

constexpr std::uint64_t random_bits(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
    return mix64(mix64(mix64(seed) ^ stream) ^ index);
}

// Uniform in [0, 1).
constexpr double random_unit(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
    return static_cast<double>(random_bits(seed, stream, index) >> 11U) * 0x1p-53;
}

// Uniform in [-1, 1).
constexpr double random_sign(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
    return 2 * random_unit(seed, stream, index) - 1;
}

}  // namespace hord::sim
