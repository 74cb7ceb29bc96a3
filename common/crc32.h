// CRC-32 as Ethernet, zip and PNG have it (IEEE 802.3, reflected, polynomial 0xEDB88320).
#pragma once

#include <cstdint>
#include <string_view>

namespace hord::common {

class Crc32 {
  public:
    constexpr void add(std::uint8_t byte) {
        crc_ ^= byte;
        for (int bit = 0; bit < 8; ++bit) crc_ = crc_ >> 1U ^ ((crc_ & 1U) != 0 ? 0xEDB88320U : 0U);
    }
    constexpr void add(std::string_view text) {
        for (const char c : text) add(static_cast<std::uint8_t>(c));
    }
    [[nodiscard]] constexpr std::uint32_t value() const { return ~crc_; }

  private:
    std::uint32_t crc_ = ~0U;
};

constexpr std::uint32_t crc32(std::string_view text) {
    Crc32 crc;
    crc.add(text);
    return crc.value();
}
static_assert(crc32("123456789") == 0xCBF43926);  // the check value of the catalogues

}  // namespace hord::common
