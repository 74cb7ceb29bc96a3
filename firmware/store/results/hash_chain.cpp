#include "firmware/store/results/hash_chain.h"

#include <algorithm>
#include <bit>
#include <charconv>

#include <sha2.h>
#include <sys/types.h>

namespace hord::firmware::store {
namespace {

class Sha256 {
  public:
    Sha256() { SHA256Init(&context_); }
    void add(std::span<const std::uint8_t> bytes) { SHA256Update(&context_, bytes.data(), bytes.size()); }
    void add(std::string_view text) { add({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}); }
    void add(std::uint8_t byte) { add(std::span<const std::uint8_t>(&byte, 1)); }
    void add_word(std::uint64_t word) {
        std::array<std::uint8_t, 8> bytes{};
        for (std::size_t k = 0; k < bytes.size(); ++k) bytes[k] = static_cast<std::uint8_t>(word >> (8 * k));
        add(bytes);
    }
    [[nodiscard]] Hash digest() {
        Hash hash{};
        SHA256Final(hash.data(), &context_);
        return hash;
    }

  private:
    SHA2_CTX context_{};
};

}  // namespace

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
            sum.add('i');
            sum.add_word(static_cast<std::uint64_t>(*integer));
        } else if (const auto* real = std::get_if<double>(&value)) {
            sum.add('f');
            sum.add_word(std::bit_cast<std::uint64_t>(*real));
        } else if (const auto* text = std::get_if<std::string>(&value)) {
            sum.add('t');
            sum.add_word(text->size());
            sum.add(*text);
        } else if (const auto* blob = std::get_if<Blob>(&value)) {
            sum.add('b');
            sum.add_word(blob->size());
            sum.add(*blob);
        } else {
            sum.add('n');
        }
    }
    return sum.digest();
}

std::string to_hex(std::span<const std::uint8_t> bytes) {
    std::string text;
    for (const std::uint8_t byte : bytes) {
        text += "0123456789abcdef"[byte >> 4U];
        text += "0123456789abcdef"[byte & 15U];
    }
    return text;
}

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
