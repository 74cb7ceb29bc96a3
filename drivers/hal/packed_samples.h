// Unpacks rows of 10- and 12-bit samples in MIPI packing (V4L2's Y10P and Y12P) to 16-bit samples, right-aligned. The
// high eight bits of each sample are a byte of its own; one more byte holds the low bits of the group.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace hord::drivers {

// Bytes of a row of `width` samples, without padding; an incomplete last group has all of its bytes.
[[nodiscard]] constexpr std::size_t packed10_bytes(std::size_t width) { return (width + 3) / 4 * 5; }
[[nodiscard]] constexpr std::size_t packed12_bytes(std::size_t width) { return (width + 1) / 2 * 3; }
[[nodiscard]] constexpr std::size_t packed_row_bytes(int bits, std::size_t width) {  // 10 or 12 bits
    return bits == 10 ? packed10_bytes(width) : packed12_bytes(width);
}

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

// Unpacks the complete rows in the first `bytes_used` bytes of a frame; `bits` is 10 or 12, `samples` holds all rows of
// `width` samples without padding. Returns the bytes of the unpacked rows.
inline std::size_t unpack_rows(const std::byte* frame, std::size_t stride, std::size_t bytes_used, int bits,
                               std::size_t width, std::span<std::uint16_t> samples) {
    const std::size_t height = samples.size() / width;
    const std::size_t row_bytes = packed_row_bytes(bits, width);
    std::size_t row = 0;
    for (; row < height && row * stride + row_bytes <= bytes_used; ++row) {
        (bits == 10 ? unpack10 : unpack12)({frame + row * stride, row_bytes}, samples.subspan(row * width, width));
    }
    return row * width * sizeof(std::uint16_t);
}

}  // namespace hord::drivers
