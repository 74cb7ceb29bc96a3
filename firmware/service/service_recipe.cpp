// The recipe in use over restarts: kept in the state folder, taken from there at the start.
#include <filesystem>
#include <utility>

#include <fmt/format.h>

#include "algo/inspection/pipeline.h"
#include "common/file_writing.h"
#include "firmware/core/faults.h"
#include "firmware/recipes/recipe_folder.h"
#include "firmware/service/service.h"

namespace hord::firmware {
namespace {

constexpr const char* kRecipeInUse = "recipe-in-use.toml";
// The CRC-32 of the recipe that was in use last: tells that the file above is missing or an older one. Two lines: the
// process ended while it kept the second recipe, and either may be in the file.
constexpr const char* kLastInUse = "recipe-in-use.crc32";
constexpr std::size_t kLine = 9;

// The kept recipe, if it fits the light field: the camera, the calibration or inspection.macro may be another since.
Result<std::optional<RememberedRecipe>> fitting(RememberedRecipe kept, const std::filesystem::path& file,
                                                const algo::Extents& extents, int bits) {
    const auto fits = algo::check_recipe(kept.recipe->recipe, extents, bits);
    if (fits) return kept;
    const std::string reference = kept.recipe->reference_file.string();
    return fail(fits.error().code,
                fmt::format("{}{}{}: {}", file.string(), reference.empty() ? "" : " with its reference ", reference,
                            fits.error().message()),
                "commit, select or teach the recipe again");
}

// Damaged at an earlier start, and no recipe was selected since.
std::optional<Error> damaged_before(const std::filesystem::path& in_use) {
    std::error_code ignored;
    const auto damaged = damaged_recipe(in_use);
    if (std::filesystem::exists(in_use, ignored) ||
        !std::filesystem::exists(std::filesystem::symlink_status(damaged, ignored)))
        return std::nullopt;
    return Error{ErrorCode::invalid_argument,
                 damaged.string() + " was damaged at an earlier start, and no recipe was selected since",
                 "commit or select the recipe again, or remove that file and restart"};
}

std::string line_of(std::uint32_t crc) { return fmt::format("{:08X}\n", crc); }

// Empty: not known.
std::string read_last(const std::filesystem::path& file) {
    const std::string text = common::read_file(file).value_or("");
    const bool whole = (text.size() == kLine || text.size() == 2 * kLine) && text[kLine - 1] == '\n' &&
        text.back() == '\n' && text.find_first_not_of("0123456789ABCDEF\n") == std::string::npos;
    return whole ? text : std::string();
}

}  // namespace

std::vector<Error> problems_of_kept_recipe(const Config& config, const StationFiles& files) {
    std::vector<Error> all;
    if (config.state_folder.empty()) return all;
    NumberedRecipe recipe = files.recipe;
    const auto look = [&](const std::filesystem::path& file, const std::filesystem::path& recipes) {
        auto kept = look_at_remembered(file, recipe, recipes);
        if (kept && *kept && (*kept)->recipe && files.light_field)
            kept = fitting(std::move(**kept), file, files.light_field->extents, files.light_field->bits);
        if (!kept) all.push_back(kept.error());
        else if (*kept && (*kept)->recipe) recipe = std::move(*(*kept)->recipe);
    };
    const auto in_use = config.state_folder / kRecipeInUse;
    if (const auto before = damaged_before(in_use)) all.push_back(*before);
    look(in_use, config.inspection.recipes);
    look(LineTeachIn::pending_file(config.state_folder), {});
    return all;
}

// The recipe that was in use before the restart, or `configured`.
NumberedRecipe Service::take_kept(RememberedRecipe kept, NumberedRecipe configured, const std::filesystem::path& file) {
    NumberedRecipe recipe = kept.recipe ? std::move(*kept.recipe) : std::move(configured);
    const std::uint32_t now = crc32_of(recipe);
    if (kept.crc32 == 0) {
        on_trouble({ErrorCode::unsupported,
                    fmt::format("{} is of an earlier version and has no checksum: whether it is whole is not known; "
                                "recipe {} is in use as it says, with {} zones, {} tolerances and {} reference, CRC-32 "
                                "{:08X}",
                                file.string(), recipe.number, recipe.recipe.zones.size(),
                                recipe.recipe.tolerances.size(), recipe.recipe.reference ? "a" : "no", now),
                    "compare the recipe with what was committed"});
    } else if (kept.crc32 != now) {
        const std::string file_of_it = config_.inspection.recipe.string(), its = recipe.reference_file.string();
        std::string why = fmt::format("the configured recipe{}{}{} has changed since",
                                      file_of_it.empty() ? "" : " " + file_of_it,
                                      its.empty() ? "" : " or its reference ", its),
                    cure = "put the old one back and restart, or commit it again";
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
NumberedRecipe Service::first_recipe(const algo::Extents& extents, int bits) {
    NumberedRecipe recipe = std::move(configured_);
    configured_recipe_ = crc32_of(recipe);
    if (config_.state_folder.empty()) return recipe;
    const auto take = [&](const std::filesystem::path& file, Result<std::optional<RememberedRecipe>> kept) {
        if (kept && *kept && (*kept)->recipe) kept = fitting(std::move(**kept), file, extents, bits);
        if (!kept) kept_is_lost(kept.error(), recipe);
        else if (*kept) recipe = take_kept(std::move(**kept), std::move(recipe), file);
    };
    const auto in_use = config_.state_folder / kRecipeInUse, damaged = damaged_recipe(in_use);
    std::error_code ignored;
    // What a process was writing when it was killed. Nobody else writes here: the folder is locked.
    for (std::filesystem::directory_iterator at(config_.state_folder, ignored), end; at != end; at.increment(ignored)) {
        const std::string name = at->path().filename().string();
        if (name.starts_with(kRecipeInUse) && name.ends_with(".new")) std::filesystem::remove(at->path(), ignored);
    }
    if (const auto before = damaged_before(in_use)) kept_is_lost(*before, recipe);
    auto kept = remembered_recipe(in_use, recipe, config_.inspection.recipes);
    const auto last_file = config_.state_folder / kLastInUse;
    const bool missing = !std::filesystem::exists(in_use, ignored);
    // A damaged file is told of by its own name, until somebody removes it.
    if (missing && std::filesystem::exists(std::filesystem::symlink_status(damaged, ignored)))
        std::filesystem::remove(last_file, ignored);
    const std::string last = read_last(last_file), then = last.substr(0, kLine - 1);
    const auto was_last = [&](std::uint32_t crc) { return last.empty() || last.find(line_of(crc)) != last.npos; };
    if (kept && missing && !was_last(crc32_of(recipe))) {
        kept_is_lost({ErrorCode::not_found,
                      fmt::format("{} is missing, and the recipe with CRC-32 {} was in use", in_use.string(), then),
                      fmt::format("commit or select the recipe again, or remove {} and restart", last_file.string())},
                     recipe);
    } else if (kept && *kept && (*kept)->recipe && (*kept)->crc32 != 0 && !was_last((*kept)->crc32)) {
        on_trouble({ErrorCode::invalid_argument,
                    fmt::format("recipe {} is not what was in use before the restart: {} has CRC-32 {:08X}, {} was in "
                                "use last; the file is an older one, or of another station",
                                (*kept)->recipe->number, in_use.string(), (*kept)->crc32, then),
                    "if nobody meant that, commit or select the recipe again"});
    }
    take(in_use, std::move(kept));
    take(LineTeachIn::pending_file(config_.state_folder), LineTeachIn::pending_recipe(config_.state_folder, recipe));
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
    const auto last_file = config_.state_folder / kLastInUse;
    const std::string last = read_last(last_file), now = line_of(crc32_of(recipe));
    Result<void> kept;
    if (last != now) kept = common::write_durably(last_file, last.substr(0, last.empty() ? 0 : kLine) + now);
    if (kept) kept = remember_recipe(config_.state_folder / kRecipeInUse, configured_recipe_, recipe);
    // Should this fail, the next start takes either for the last one.
    if (last != now && (kept || !last.empty())) (void)common::write_durably(last_file, kept ? now : last);
    if (kept) teach_in_->in_use(recipe);
    // Short, so that REPLY holds it.
    else if (kept.error().code == ErrorCode::refused) kept.error().cure = "remove it, then commit or select again";
    else kept.error().cure = "check the folder's owner and its disk";
    return kept;
}

}  // namespace hord::firmware
