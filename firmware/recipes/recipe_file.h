// A recipe as TOML. deploy/recipes/default.toml documents every key.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "algo/recipe/recipe.h"
#include "common/result.h"

namespace hord::firmware {

inline constexpr std::uint32_t kMaxArea = 1'000'000;  // of limits.min_area in a file, lenslets

// A recipe with its identity for the PLC and the records.
struct NumberedRecipe {
    std::uint16_t number = 0;   // by which a PLC selects it, 0..65534
    std::uint32_t version = 1;  // whoever changes the recipe increments it
    algo::Recipe recipe = {};
    std::filesystem::path reference_file = {};   // file of recipe.reference; empty: none
    std::vector<std::string> unset_limits = {};  // keys of [limits] for its features that its file does not set
};

// The recipe as the text of a recipe file; parsing it gives the same recipe.
std::string format_recipe(const NumberedRecipe& recipe);

// The same with the reference's path relative to `folder`, if the reference lies in it: the folder can be copied.
std::string format_recipe_in(const std::filesystem::path& folder, const NumberedRecipe& recipe);

// CRC-32 of the content: independent of the file's formatting and of the reference file's path, but not of the
// reference's content.
std::uint32_t crc32_of(const NumberedRecipe& recipe);

// Fail with invalid_argument: all problems of the file at once, one a line with line number and cure. Whether the zones
// lie on the light field is checked later, with its extents: algo::problems(recipe, extents).
Result<NumberedRecipe> load_numbered_recipe(const std::filesystem::path& file);
// `max_area`: the largest limits.min_area that the caller can hold. `folder`: a relative path of a reference starts
// there.
Result<NumberedRecipe> parse_numbered_recipe(std::string_view text, std::string_view name,
                                             std::uint32_t max_area = kMaxArea,
                                             const std::filesystem::path& folder = {});
// The text of a recipe's file. It must have `schema` and end with a line end: a part of a file can lack either.
Result<NumberedRecipe> parse_recipe_file(std::string_view text, const std::filesystem::path& file);

// The file that a recipe's [reference] names: a relative path starts in the recipe's folder ("": not known).
std::filesystem::path reference_path(const std::filesystem::path& named, const std::filesystem::path& folder);

// What the recipe allows and hardly anybody wants: algo::notes(), limits that count though the file does not set them,
// a name that registers cut.
std::vector<std::string> notes(const NumberedRecipe& recipe);

// The same for the default recipe where `file` is empty.
Result<NumberedRecipe> recipe_or_default(const std::filesystem::path& file);

// The same without number and version.
Result<algo::Recipe> parse_recipe(std::string_view text, std::string_view name);

}  // namespace hord::firmware
