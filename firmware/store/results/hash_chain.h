// The hash chain: every row carries the SHA-256 of the row before it and of itself.
//
//     hash(row) = SHA-256( hash(row before) , each value as: one byte type, length or 8 bytes little-endian, bytes )
//
// The chain begins with genesis(), which differs between stores and chains: rows cannot be moved between them. To hide
// a changed, removed or inserted row, every later hash must be recomputed; a head noted elsewhere reveals that
// (docs/store.md).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <sha2.h>

#include "firmware/store/results/database.h"

namespace hord::firmware::store {

using Hash = std::array<std::uint8_t, 32>;

// Incremental SHA-256.
class Sha256 {
  public:
    Sha256() { SHA256Init(&context_); }
    void add(std::span<const std::uint8_t> bytes) { SHA256Update(&context_, bytes.data(), bytes.size()); }
    void add(std::string_view text) { add({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}); }
    [[nodiscard]] Hash digest() const;  // of what was added so far

  private:
    SHA2_CTX context_{};
};

Hash sha256(std::span<const std::uint8_t> bytes);
Hash genesis(std::string_view store_id, std::string_view chain);
Hash follow(const Hash& before, std::span<const Value> row);

std::string to_hex(std::span<const std::uint8_t> bytes);
std::optional<Hash> hash_from_hex(std::string_view text);
Value to_value(const Hash& hash);
bool equals(const Value& value, const Hash& hash);

}  // namespace hord::firmware::store
