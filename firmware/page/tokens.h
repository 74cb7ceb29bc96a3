// The people who may command the station from the page.
//
// A file of lines "NAME TOKEN"; '#' begins a comment. The name is recorded with each command. Memory holds digests
// only. A token is compared with all of them in constant time.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/result.h"

namespace hord::firmware::page {

constexpr std::size_t kShortestToken = 24, kLongestToken = 256, kLongestName = 20;

class Tokens {
  public:
    Tokens() = default;  // no tokens: owner() is always empty

    // Fails with not_found, refused (others may read or write the file), invalid_argument (a line that is not a name
    // and a token, a token that is too short, a name or token twice).
    static Result<Tokens> load(const std::filesystem::path& file);
    static Result<Tokens> parse(std::string_view text, const std::string& name);

    [[nodiscard]] bool empty() const { return entries_.empty(); }
    // The name of the token's owner; empty for an unknown token.
    [[nodiscard]] std::optional<std::string> owner(std::string_view token) const;

  private:
    struct Entry {
        std::string name;
        std::array<std::uint8_t, 32> digest;
    };
    std::vector<Entry> entries_;
};

}  // namespace hord::firmware::page
