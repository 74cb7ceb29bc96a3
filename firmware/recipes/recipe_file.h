// A recipe as TOML. deploy/recipes/default.toml documents every key.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "algo/recipe/recipe.h"
#include "common/result.h"

namespace hord::firmware {

// A recipe with what a PLC and a record must know of it.
struct NumberedRecipe {
    std::uint16_t number = 0;   // how a PLC calls it, 0 to 65534
    std::uint32_t version = 1;  // raised by whoever changes it
    algo::Recipe recipe = {};
    std::filesystem::path reference_file = {};  // where recipe.reference comes from; empty: there is none
};

// Everything that it says, as the text of a recipe file; reading that gives the same recipe.
std::string format_recipe(const NumberedRecipe& recipe);

// CRC-32 of what it says, not of how a file writes it; of a reference, what is in it, wherever it lies.
std::uint32_t crc32_of(const NumberedRecipe& recipe);

// Fails with invalid_argument; every problem of the file at once, a line each with line number and cure. Whether the
// zones lie on the light field is known only with its extents: algo::problems(recipe, extents).
Result<NumberedRecipe> load_numbered_recipe(const std::filesystem::path& file);
Result<NumberedRecipe> parse_numbered_recipe(std::string_view text, std::string_view name);

// The same without its number.
Result<algo::Recipe> load_recipe(const std::filesystem::path& file);
Result<algo::Recipe> parse_recipe(std::string_view text, std::string_view name);

}  // namespace hord::firmware
