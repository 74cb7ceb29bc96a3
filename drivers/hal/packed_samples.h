// Unpacks 10- and 12-bit samples to 16-bit samples, right-aligned.
//
// MIPI (V4L2's Y10P and Y12P), row by row: the high eight bits of each sample are a byte of its own; one more byte
// holds the low bits of the group, the first sample's in its lowest bits.
// GigE Vision (Mono10Packed, Mono12Packed): two samples in three bytes; the middle byte holds the low bits, the first
// sample's from bit 0, the second one's from bit 4.
// PFNC (Mono10p, Mono12p): one stream of bits, the lowest bit first.
// GigE Vision's and PFNC's rows follow without padding and may begin inside a group: the whole frame is unpacked.
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

// Bytes of a whole frame of `samples` in GigE Vision or PFNC packing.
[[nodiscard]] constexpr std::size_t gige_bytes(std::size_t samples) { return (samples * 12 + 7) / 8; }
[[nodiscard]] constexpr std::size_t pfnc_bytes(int bits, std::size_t samples) {
    return (samples * static_cast<std::size_t>(bits) + 7) / 8;
}

// `bits` is 10 or 12. False, and nothing is unpacked: `frame` is shorter than its samples.
inline bool unpack_gige(std::span<const std::byte> frame, int bits, std::span<std::uint16_t> samples) {
    if (frame.size() < gige_bytes(samples.size())) return false;
    const int low_bits = bits - 8;
    for (std::size_t x = 0; x < samples.size(); ++x) {
        const std::size_t at = x / 2 * 3, second = x % 2;
        const auto high = std::to_integer<unsigned>(frame[at + 2 * second]),
                   low = std::to_integer<unsigned>(frame[at + 1]) >> (4 * second);
        samples[x] = static_cast<std::uint16_t>((high << low_bits) | (low & ((1U << low_bits) - 1U)));
    }
    return true;
}
inline bool unpack_pfnc(std::span<const std::byte> frame, int bits, std::span<std::uint16_t> samples) {
    if (frame.size() < pfnc_bytes(bits, samples.size())) return false;
    for (std::size_t x = 0; x < samples.size(); ++x) {
        // A sample of 10 or 12 bits begins at an even bit, so it lies in two bytes.
        const std::size_t bit = x * static_cast<std::size_t>(bits), at = bit / 8;
        const unsigned two = std::to_integer<unsigned>(frame[at]) | (std::to_integer<unsigned>(frame[at + 1]) << 8U);
        samples[x] = static_cast<std::uint16_t>((two >> (bit % 8)) & ((1U << bits) - 1U));
    }
    return true;
}

}  // namespace hord::drivers
