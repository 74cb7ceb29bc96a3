// Rows of 10- and 12-bit samples as MIPI sensors pack them (V4L2's Y10P and Y12P): the high eight bits of each sample
// in a byte of its own, the low bits of a group gathered behind them. To 16-bit samples, right-aligned.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace hord::drivers {

// Bytes that a row of `width` samples takes, without padding; a group that is not full takes all of its bytes.
[[nodiscard]] constexpr std::size_t packed10_bytes(std::size_t width) { return (width + 3) / 4 * 5; }
[[nodiscard]] constexpr std::size_t packed12_bytes(std::size_t width) { return (width + 1) / 2 * 3; }

// Four samples in five bytes: the fifth holds the low two bits of the first in its lowest two, and so on. `row` has
// packed10_bytes(samples.size()).
inline void unpack10(std::span<const std::byte> row, std::span<std::uint16_t> samples) {
    for (std::size_t x = 0; x < samples.size(); ++x) {
        const std::size_t group = x / 4 * 5, k = x % 4;
        const auto high = std::to_integer<unsigned>(row[group + k]),
                   low = std::to_integer<unsigned>(row[group + 4]) >> (2 * k);
        samples[x] = static_cast<std::uint16_t>((high << 2U) | (low & 3U));
    }
}

// Two samples in three bytes: the third holds the low four bits of the first in its lowest four. `row` has
// packed12_bytes(samples.size()).
inline void unpack12(std::span<const std::byte> row, std::span<std::uint16_t> samples) {
    for (std::size_t x = 0; x < samples.size(); ++x) {
        const std::size_t group = x / 2 * 3, k = x % 2;
        const auto high = std::to_integer<unsigned>(row[group + k]),
                   low = std::to_integer<unsigned>(row[group + 2]) >> (4 * k);
        samples[x] = static_cast<std::uint16_t>((high << 4U) | (low & 15U));
    }
}

}  // namespace hord::drivers
