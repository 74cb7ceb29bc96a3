// The recipes that a station can switch to, and the one that it remembers over a restart.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "firmware/recipes/recipe_file.h"

namespace hord::firmware {

struct FoundRecipe {
    std::filesystem::path file;
    Result<NumberedRecipe> recipe;  // or why it cannot be used
};

// Every *.toml of the folder in the order of their names. Fails with not_found (no such folder).
Result<std::vector<FoundRecipe>> list_recipes(const std::filesystem::path& folder);

// Fails with not_found (no file has this number; names those that cannot be used), refused (several have it).
Result<NumberedRecipe> find_recipe(const std::filesystem::path& folder, std::uint16_t number);

// What was in use last, for the recipe that was configured then: once another one is configured, or its file changed,
// the configured one counts again. `configured` is the CRC-32 of the configured recipe. Reading fails with
// invalid_argument where it should count and cannot be used: it, or its reference, is missing something or damaged.
Result<void> remember_recipe(const std::filesystem::path& file, std::uint32_t configured, const NumberedRecipe& in_use);
Result<std::optional<NumberedRecipe>> remembered_recipe(const std::filesystem::path& file, std::uint32_t configured);

}  // namespace hord::firmware
