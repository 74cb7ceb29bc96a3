// CRC-32 of Ethernet, zip and PNG (IEEE 802.3, reflected, polynomial 0xEDB88320).
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace hord::common {

class Crc32 {
  public:
    constexpr void add(std::uint8_t byte) { crc_ = kTable[(crc_ ^ byte) & 0xFFU] ^ (crc_ >> 8U); }
    constexpr void add(std::string_view text) {
        for (const char c : text) add(static_cast<std::uint8_t>(c));
    }
    [[nodiscard]] constexpr std::uint32_t value() const { return ~crc_; }

  private:
    static constexpr auto kTable = [] {
        std::array<std::uint32_t, 256> table{};
        for (std::uint32_t n = 0; n < 256; ++n) {
            std::uint32_t crc = n;
            for (int bit = 0; bit < 8; ++bit) crc = crc >> 1U ^ ((crc & 1U) != 0 ? 0xEDB88320U : 0U);
            table[n] = crc;
        }
        return table;
    }();
    std::uint32_t crc_ = ~0U;
};

constexpr std::uint32_t crc32(std::string_view text) {
    Crc32 crc;
    crc.add(text);
    return crc.value();
}
static_assert(crc32("123456789") == 0xCBF43926);  // the published check value

}  // namespace hord::common
