// Unpacks rows of 10- and 12-bit samples in MIPI packing (V4L2's Y10P and Y12P) to 16-bit samples, right-aligned. The
// high eight bits of each sample are a byte of its own; one more byte holds the low bits of the group, the first
// sample's in its lowest bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace hord::drivers {

// Samples a group: four in five bytes, or two in three.
[[nodiscard]] constexpr std::size_t packed_group(int bits) { return bits == 10 ? 4 : 2; }

// Bytes of a row of `width` samples of 10 or 12 bits, without padding; an incomplete last group has all of its bytes.
[[nodiscard]] constexpr std::size_t packed_row_bytes(int bits, std::size_t width) {
    const std::size_t group = packed_group(bits);
    return (width + group - 1) / group * (group + 1);
}

// `row` has packed_row_bytes(kBits, samples.size()).
template <int kBits>
void unpack(std::span<const std::byte> row, std::span<std::uint16_t> samples) {
    constexpr std::size_t kGroup = packed_group(kBits);
    constexpr unsigned kLowBits = kBits - 8;
    for (std::size_t x = 0; x < samples.size(); ++x) {
        const std::size_t at = x / kGroup * (kGroup + 1), k = x % kGroup;
        const auto high = std::to_integer<unsigned>(row[at + k]),
                   low = std::to_integer<unsigned>(row[at + kGroup]) >> (kLowBits * k);
        samples[x] = static_cast<std::uint16_t>((high << kLowBits) | (low & ((1U << kLowBits) - 1U)));
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
        (bits == 10 ? unpack<10> : unpack<12>)({frame + row * stride, row_bytes}, samples.subspan(row * width, width));
    }
    return row * width * sizeof(std::uint16_t);
}

}  // namespace hord::drivers
