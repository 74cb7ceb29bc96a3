// The recipes that a station can switch to, and the one that it uses again after a restart.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "firmware/recipes/recipe_file.h"

namespace hord::firmware {

struct RecipeEntry {
    std::filesystem::path file;
    Result<NumberedRecipe> recipe;  // or the reason why it cannot be used
};

// All *.toml files of the folder, sorted by name. Fails with not_found (no such folder).
Result<std::vector<RecipeEntry>> list_recipes(const std::filesystem::path& folder);

// Fails with refused if recipes of one folder have the same number: names the files.
Result<void> check_numbers(const std::vector<RecipeEntry>& recipes);

// Fails with not_found (no file has this number; names the unusable files), refused (several files have it).
Result<NumberedRecipe> find_recipe(const std::filesystem::path& folder, std::uint16_t number);

// The recipe that was in use last, stored with the CRC-32 of the recipe that was configured then (`configured`). It is
// returned only if that recipe is still configured and unchanged. Reading fails with invalid_argument if it, or its
// reference, is incomplete or damaged.
Result<void> remember_recipe(const std::filesystem::path& file, std::uint32_t configured, const NumberedRecipe& in_use);
Result<std::optional<NumberedRecipe>> remembered_recipe(const std::filesystem::path& file, std::uint32_t configured);

}  // namespace hord::firmware
