// The recipes that a station can switch to, and the one that it uses again after a restart.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "firmware/recipes/recipe_file.h"

namespace hord::firmware {

struct RecipeEntry {
    std::filesystem::path file;
    Result<NumberedRecipe> recipe;  // or the reason why it cannot be used
};

// All *.toml files of the folder, sorted by name. Fails with not_found (no such folder), unreadable (no right, no
// folder).
Result<std::vector<RecipeEntry>> list_recipes(const std::filesystem::path& folder);

// Fails with refused if recipes of one folder have the same number: names the files.
Result<void> check_numbers(const std::vector<RecipeEntry>& recipes);
// The same of a folder, for a start: reads the numbers alone, no reference. A file without a number that can be read is
// passed over. Fails as list_recipes(), too; "": no folder, fine.
Result<void> check_recipe_numbers(const std::filesystem::path& folder);
// For a start, too: the recipes of the folder whose reference is missing or is no reference. Only the head of its file
// is read: a reference of 555x555 lenslets has 90 MB.
std::vector<Error> missing_references(const std::filesystem::path& folder);

// Loads the recipe with this number, and no other one's reference. Fails with not_found (no file has this number; names
// the files whose number cannot be read), refused (several have it), or as its file.
Result<NumberedRecipe> find_recipe(const std::filesystem::path& folder, std::uint16_t number);

// The recipe that was in use last, stored with the CRC-32 of the recipe that was configured then. The file's last line
// is the CRC-32 of the bytes before it.
Result<void> remember_recipe(const std::filesystem::path& file, std::uint32_t configured, const NumberedRecipe& in_use);

struct RememberedRecipe {
    std::uint32_t crc32 = 0;  // crc32_of() it when it was stored; 0: not known, an earlier version wrote the file
    // None: another recipe is configured since, and what was committed or learned is over.
    std::optional<NumberedRecipe> recipe;
};
// None: no file, or one of an earlier version that has what was configured then. A damaged file (cut, changed, not a
// regular file) is renamed FILE.damaged; reading fails then with invalid_argument, and the error says where the file
// is. Reading fails, too, if the file or the recipe's reference cannot be read; the file stays then. `recipes`: the
// folder from which a recipe may have been selected: tells what a file of an earlier version has lost.
Result<std::optional<RememberedRecipe>> remembered_recipe(const std::filesystem::path& file,
                                                          const NumberedRecipe& configured,
                                                          const std::filesystem::path& recipes = {});
// The same, before a start: the file stays as it is.
Result<std::optional<RememberedRecipe>> look_at_remembered(const std::filesystem::path& file,
                                                           const NumberedRecipe& configured,
                                                           const std::filesystem::path& recipes = {});
std::filesystem::path damaged_recipe(const std::filesystem::path& file);  // FILE.damaged

// What the store keeps of a recipe: format_recipe(), and the checksum of its reference in a comment.
std::string recorded_recipe(const NumberedRecipe& recipe);

}  // namespace hord::firmware
