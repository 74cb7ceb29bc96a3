#include "firmware/store/results/hash_chain.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <optional>

#include <fmt/format.h>

namespace hord::firmware::store {
namespace {

// One value of a row: its type, its length or its eight bytes, and its bytes.
void add_value(Sha256& sum, char type, std::optional<std::uint64_t> word = {},
               std::span<const std::uint8_t> bytes = {}) {
    sum.add(std::string_view(&type, 1));
    std::array<std::uint8_t, 8> little_endian{};
    for (std::size_t k = 0; k < 8; ++k) little_endian[k] = static_cast<std::uint8_t>(word.value_or(0) >> (8 * k));
    if (word) sum.add(little_endian);
    sum.add(bytes);
}

std::span<const std::uint8_t> bytes_of(std::string_view text) {
    return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

}  // namespace

Hash Sha256::digest() const {
    SHA2_CTX copy = context_;
    Hash hash{};
    SHA256Final(hash.data(), &copy);
    return hash;
}

Hash sha256(std::span<const std::uint8_t> bytes) {
    Sha256 sum;
    sum.add(bytes);
    return sum.digest();
}

Hash genesis(std::string_view store_id, std::string_view chain) {
    Sha256 sum;
    sum.add("hord-store\n");
    sum.add(store_id);
    sum.add("\n");
    sum.add(chain);
    return sum.digest();
}

Hash follow(const Hash& before, std::span<const Value> row) {
    Sha256 sum;
    sum.add(before);
    for (const Value& value : row) {
        if (const auto* integer = std::get_if<std::int64_t>(&value)) {
            add_value(sum, 'i', static_cast<std::uint64_t>(*integer));
        } else if (const auto* real = std::get_if<double>(&value)) {
            add_value(sum, 'f', std::bit_cast<std::uint64_t>(*real));
        } else if (const auto* text = std::get_if<std::string>(&value)) {
            add_value(sum, 't', text->size(), bytes_of(*text));
        } else if (const auto* blob = std::get_if<Blob>(&value)) {
            add_value(sum, 'b', blob->size(), *blob);
        } else {
            add_value(sum, 'n');
        }
    }
    return sum.digest();
}

std::string to_hex(std::span<const std::uint8_t> bytes) { return fmt::format("{:02x}", fmt::join(bytes, "")); }

std::optional<Hash> hash_from_hex(std::string_view text) {
    Hash hash{};
    if (text.size() != 2 * hash.size()) return std::nullopt;
    for (std::size_t k = 0; k < hash.size(); ++k) {
        const char* pair = text.data() + 2 * k;
        const auto read = std::from_chars(pair, pair + 2, hash[k], 16);
        if (read.ec != std::errc() || read.ptr != pair + 2) return std::nullopt;
    }
    return hash;
}

Value to_value(const Hash& hash) { return Blob(hash.begin(), hash.end()); }

bool equals(const Value& value, const Hash& hash) {
    const auto* blob = std::get_if<Blob>(&value);
    return blob != nullptr && std::equal(blob->begin(), blob->end(), hash.begin(), hash.end());
}

}  // namespace hord::firmware::store
