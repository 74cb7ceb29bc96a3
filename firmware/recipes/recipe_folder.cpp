#include "firmware/recipes/recipe_folder.h"

#include <algorithm>
#include <iterator>

#include <fmt/format.h>

#include "common/file_writing.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;

std::string head_line(std::uint32_t configured) {
    return fmt::format("# In use since it was committed. Configured then: {:08X}\n", configured);
}

}  // namespace

Result<std::vector<RecipeEntry>> list_recipes(const fs::path& folder) {
    std::error_code error;
    std::vector<fs::path> files;
    for (auto entry = fs::directory_iterator(folder, error); !error && entry != fs::directory_iterator();
         entry.increment(error)) {
        if (entry->path().extension() == ".toml") files.push_back(entry->path());
    }
    if (error) {
        return fail(ErrorCode::not_found, fmt::format("the folder of recipes {}: {}", folder.string(), error.message()),
                    "make it, or name another one in inspection.recipes");
    }
    std::sort(files.begin(), files.end());
    std::vector<RecipeEntry> all;
    for (const fs::path& file : files) all.push_back({file, load_numbered_recipe(file)});
    return all;
}

Result<void> check_numbers(const std::vector<RecipeEntry>& recipes) {
    std::string doubled;
    for (std::size_t k = 0; k < recipes.size(); ++k) {
        for (std::size_t other = 0; other < k; ++other) {
            const RecipeEntry &a = recipes[other], &b = recipes[k];
            if (!a.recipe || !b.recipe || a.recipe->number != b.recipe->number) continue;
            std::error_code error;
            const fs::path one = fs::weakly_canonical(a.file, error), two = fs::weakly_canonical(b.file, error);
            if (one == two || one.parent_path() != two.parent_path()) continue;
            doubled += fmt::format("{}{} and {} both have number {}", doubled.empty() ? "" : ", ", a.file.string(),
                                   b.file.string(), a.recipe->number);
            break;
        }
    }
    if (doubled.empty()) return {};
    return fail(ErrorCode::refused, doubled, "give each recipe a number of its own");
}

Result<NumberedRecipe> find_recipe(const fs::path& folder, std::uint16_t number) {
    auto all = list_recipes(folder);
    if (!all) return tl::unexpected(all.error());
    const RecipeEntry* found = nullptr;
    std::string unusable;
    for (const RecipeEntry& one : *all) {
        if (!one.recipe) {
            unusable += "; " + one.recipe.error().message();
        } else if (one.recipe->number == number) {
            if (found != nullptr) {
                return fail(
                    ErrorCode::refused,
                    fmt::format("{} and {} both have number {}", found->file.string(), one.file.string(), number),
                    "give each recipe a number of its own");
            }
            found = &one;
        }
    }
    if (found != nullptr) return *found->recipe;
    return fail(ErrorCode::not_found, fmt::format("no recipe in {} has number {}{}", folder.string(), number, unusable),
                "hordctl recipe list shows which there are");
}

Result<void> remember_recipe(const fs::path& file, std::uint32_t configured, const NumberedRecipe& in_use) {
    return common::write_durably(file, head_line(configured) + format_recipe(in_use));
}

Result<std::optional<NumberedRecipe>> remembered_recipe(const fs::path& file, std::uint32_t configured) {
    const std::string text = common::read_file(file).value_or("");
    if (!text.starts_with(head_line(configured))) return std::nullopt;
    auto recipe = parse_numbered_recipe(text, file.string());
    if (!recipe) return tl::unexpected(recipe.error());
    return std::optional(std::move(*recipe));
}

}  // namespace hord::firmware
