// FNV-1a, 64 bits: finds accidental changes and tells results apart. It gives no protection against intent.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace hord::common {

class Fnv1a64 {
  public:
    // One step of the hash. The standard hashes bytes; hashing a whole word is faster and gives another value.
    constexpr void add_word(std::uint64_t word) { value_ = (value_ ^ word) * 0x100000001B3U; }
    constexpr void add(std::string_view bytes) {
        for (const char byte : bytes) add_word(static_cast<unsigned char>(byte));
    }
    constexpr void add(std::span<const std::byte> bytes) {
        for (const std::byte byte : bytes) add_word(static_cast<std::uint64_t>(byte));
    }
    [[nodiscard]] constexpr std::uint64_t value() const { return value_; }

  private:
    std::uint64_t value_ = 0xCBF29CE484222325U;
};

}  // namespace hord::common
