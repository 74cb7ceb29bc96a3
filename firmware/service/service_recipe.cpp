// The recipe in use over restarts: kept in the state folder, taken from there at the start.
#include <filesystem>
#include <utility>

#include <fmt/format.h>

#include "firmware/core/faults.h"
#include "firmware/recipes/recipe_folder.h"
#include "firmware/service/service.h"

namespace hord::firmware {
namespace {

constexpr const char* kRecipeInUse = "recipe-in-use.toml";

}  // namespace

// The recipe that was in use before the restart, or `configured`.
NumberedRecipe Service::take_kept(RememberedRecipe kept, NumberedRecipe configured, const std::filesystem::path& file) {
    NumberedRecipe recipe = kept.recipe ? std::move(*kept.recipe) : std::move(configured);
    const std::uint32_t now = crc32_of(recipe);
    if (kept.crc32 == 0) {
        on_trouble({ErrorCode::unsupported,
                    fmt::format("{} is of an earlier version and has no checksum: whether it is whole is not known; "
                                "recipe {} is in use as it says, CRC-32 {:08X}",
                                file.string(), recipe.number, now),
                    "compare the recipe with what was committed"});
    } else if (kept.crc32 != now) {
        std::string why = "the configured recipe or its reference has changed since", cure = "commit it again";
        if (kept.recipe) {
            const std::string reference = recipe.reference_file.string();
            why =
                reference.empty() ? "this software reads it otherwise" : "its reference " + reference + " was replaced";
            cure = "put the old reference back and restart";
        }
        on_trouble(
            {ErrorCode::invalid_argument,
             fmt::format("recipe {} is not what was in use before the restart: CRC-32 {:08X} now, {:08X} then; {}",
                         recipe.number, now, kept.crc32, why),
             "if nobody meant that, " + cure});
    }
    return recipe;
}

// The recipe that was in use before the restart cannot be used again. The fault stays until a recipe is kept.
void Service::kept_is_lost(const Error& why, const NumberedRecipe& instead) {
    recipe_fault_ = kFaultConfiguration;
    on_trouble(
        {why.code,
         fmt::format("what was in use or learned before the restart cannot be used, recipe {} with CRC-32 {:08X} "
                     "is in use: {}",
                     instead.number, crc32_of(instead), why.what),
         why.cure});
}

// The configured recipe, or the one that commands have selected since.
Result<NumberedRecipe> Service::first_recipe() {
    auto recipe = recipe_or_default(config_.inspection.recipe);
    if (!recipe) return recipe;
    configured_recipe_ = crc32_of(*recipe);
    if (config_.state_folder.empty()) return recipe;
    if (auto here = state_lock_.check_place(); !here) return tl::unexpected(here.error());
    const auto take = [&](const std::filesystem::path& file, Result<std::optional<RememberedRecipe>> kept) {
        if (!kept) kept_is_lost(kept.error(), *recipe);
        else if (*kept) recipe = take_kept(std::move(**kept), std::move(*recipe), file);
    };
    const auto in_use = config_.state_folder / kRecipeInUse, damaged = damaged_recipe(in_use);
    std::error_code ignored;
    // What a process was writing when it was killed. Nobody else writes here: the folder is locked.
    for (std::filesystem::directory_iterator at(config_.state_folder, ignored), end; at != end; at.increment(ignored)) {
        const std::string name = at->path().filename().string();
        if (name.starts_with(kRecipeInUse) && name.ends_with(".new")) std::filesystem::remove(at->path(), ignored);
    }
    if (!std::filesystem::exists(in_use, ignored) && std::filesystem::exists(damaged, ignored)) {
        kept_is_lost({ErrorCode::invalid_argument,
                      damaged.string() + " was damaged at an earlier start, and no recipe was selected since",
                      "commit or select the recipe again, or remove that file and restart"},
                     *recipe);
    }
    take(in_use, remembered_recipe(in_use, *recipe));
    take(LineTeachIn::pending_file(config_.state_folder), LineTeachIn::pending_recipe(config_.state_folder, *recipe));
    return recipe;
}

// Writes what a restart uses again.
Result<void> Service::keep_recipe(const NumberedRecipe& recipe) {
    if (config_.state_folder.empty()) return {};
    if (auto here = state_lock_.check_place(); !here) {
        recipe_fault_ = kFaultConfiguration;
        loop_->post([this] { report_faults(); });
        return here;
    }
    auto kept = remember_recipe(config_.state_folder / kRecipeInUse, configured_recipe_, recipe);
    if (kept) teach_in_->in_use(recipe);
    else kept.error().cure = "check the folder's owner and its disk";  // short, so that REPLY holds it
    return kept;
}

}  // namespace hord::firmware
