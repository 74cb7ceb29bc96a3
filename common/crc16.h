// CRC-16 of Modbus on a serial line: reflected polynomial 0xA001, start 0xFFFF.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace hord::common {

inline constexpr std::size_t kCrc16Bytes = 2;

[[nodiscard]] constexpr std::uint16_t crc16(std::span<const std::uint8_t> bytes) {
    unsigned crc = 0xFFFF;
    for (const std::uint8_t byte : bytes) {
        crc ^= byte;
        for (int bit = 0; bit < 8; ++bit) crc = crc >> 1U ^ ((crc & 1U) != 0 ? 0xA001U : 0U);
    }
    return static_cast<std::uint16_t>(crc);
}

// Fills the last two bytes of `frame` with the CRC of those before them, low byte first. At least two bytes.
constexpr void write_crc16(std::span<std::uint8_t> frame) {
    const std::uint16_t crc = crc16(frame.first(frame.size() - kCrc16Bytes));
    frame[frame.size() - 2] = static_cast<std::uint8_t>(crc & 0xFFU);
    frame[frame.size() - 1] = static_cast<std::uint8_t>(crc >> 8U);
}

// Whether `frame` ends with the CRC of what stands before it. False for fewer than three bytes.
[[nodiscard]] constexpr bool ends_with_crc16(std::span<const std::uint8_t> frame) {
    return frame.size() > kCrc16Bytes &&
        crc16(frame.first(frame.size() - kCrc16Bytes)) == (frame[frame.size() - 2] | frame[frame.size() - 1] << 8U);
}

}  // namespace hord::common
