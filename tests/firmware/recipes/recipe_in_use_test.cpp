// The file of the recipe in use: in a state folder that was copied, cut where no checksum tells it, and as a broken
// link.
#include <filesystem>
#include <fstream>
#include <string>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/file_writing.h"
#include "firmware/recipes/recipe_folder.h"
#include "firmware/recipes/reference_file.h"
#include "tests/support/temp_folder.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

algo::Reference small_reference() {
    algo::Reference r;
    r.extents = {5, 4, 3, 3};
    r.parts = 9;
    r.levels = {6, 60, 255};
    const std::size_t count = r.extents.lenslets();
    r.shares.assign(count * r.stride(), 0);
    for (std::size_t k = 0; k < count; ++k) r.shares[k * r.stride() + r.place(1, 1)] = 30'000;
    for (auto* map : {&r.light, &r.x, &r.y, &r.emd, &r.frobenius}) map->assign(count, 0.25F);
    for (auto& map : r.spread) map.assign(count, 1e-4F);
    r.mask.assign(count, 0);
    return r;
}

class RecipeInUseFile : public ::testing::Test {
  protected:
    // As an earlier version wrote it: without the two checksums.
    void write_without_checksums(const NumberedRecipe& in_use) const {
        ASSERT_TRUE(remember_recipe(file, crc32_of(configured), in_use));
        const std::string text = text_of(file);
        const auto second = text.find('\n') + 1, third = text.find('\n', second) + 1;
        std::ofstream(file) << text.substr(0, second) << text.substr(third, text.rfind("# crc32 ") - third);
    }
    static std::string text_of(const fs::path& from) { return common::read_file(from).value_or(""); }

    testing_support::TempFolder folder;
    const fs::path file = folder.path() / "recipe-in-use.toml";
    NumberedRecipe configured{.number = 3};
};

TEST_F(RecipeInUseFile, stays_as_it_is_when_it_is_only_looked_at) {
    EXPECT_FALSE(look_at_remembered(file, configured).value()) << "there is none";
    NumberedRecipe committed = configured;
    committed.recipe.name = "committed";
    ASSERT_TRUE(remember_recipe(file, crc32_of(configured), committed));
    const auto whole = look_at_remembered(file, configured);
    ASSERT_TRUE(whole && *whole && (*whole)->recipe);
    EXPECT_EQ((*whole)->recipe->recipe.name, "committed");
    const std::string cut = text_of(file).substr(0, 200);
    std::ofstream(file) << cut;
    for (int k = 0; k < 2; ++k) {
        const auto damaged = look_at_remembered(file, configured);
        ASSERT_FALSE(damaged);
        EXPECT_THAT(damaged.error().what, HasSubstr(file.string() + " is damaged ("));
        EXPECT_EQ(text_of(file), cut);
    }
    EXPECT_FALSE(fs::exists(damaged_recipe(file)));
}

TEST_F(RecipeInUseFile, finds_its_reference_in_the_folder_that_was_copied) {
    const fs::path old = folder.path() / "old", copy = folder.path() / "copy";
    fs::create_directories(old / "references");
    NumberedRecipe taught = configured;
    taught.reference_file = old / "references/taught-3-1.hordref";
    ASSERT_TRUE(write_reference(taught.reference_file, small_reference()));
    taught.recipe.reference = *read_reference(taught.reference_file);
    ASSERT_TRUE(remember_recipe(old / "recipe-in-use.toml", crc32_of(configured), taught));
    EXPECT_THAT(text_of(old / "recipe-in-use.toml"), HasSubstr("file = \"references/taught-3-1.hordref\"\n"));
    fs::copy(old, copy, fs::copy_options::recursive);
    fs::remove_all(old);
    const auto again = remembered_recipe(copy / "recipe-in-use.toml", configured);
    ASSERT_TRUE(again) << again.error().message();
    ASSERT_TRUE(*again && (*again)->recipe);
    EXPECT_EQ((*again)->recipe->reference_file, copy / "references/taught-3-1.hordref");
    EXPECT_EQ((*again)->crc32, crc32_of(*(*again)->recipe));
}

TEST_F(RecipeInUseFile, names_a_reference_of_another_folder_by_its_whole_path) {
    const fs::path reference = folder.path() / "part.hordref", state = folder.path() / "state";
    fs::create_directory(state);
    ASSERT_TRUE(write_reference(reference, small_reference()));
    NumberedRecipe in_use = configured;
    in_use.reference_file = reference;
    in_use.recipe.reference = *read_reference(reference);
    ASSERT_TRUE(remember_recipe(state / "r.toml", crc32_of(configured), in_use));
    EXPECT_THAT(text_of(state / "r.toml"), HasSubstr("file = \"" + reference.string() + "\""));
    EXPECT_TRUE((*remembered_recipe(state / "r.toml", configured))->recipe);
}

TEST_F(RecipeInUseFile, without_checksum_that_was_cut_behind_its_limits_is_damaged_and_says_what_it_lost) {
    algo::Zone zone;
    zone.centre = {4, 4};
    zone.radius = 3;
    configured.recipe.zones.assign(2, zone);
    NumberedRecipe in_use = configured;
    in_use.recipe.emd_limit_bins = 0.75F;
    write_without_checksums(in_use);
    const std::string whole = text_of(file);
    const auto kept = remembered_recipe(file, configured);
    ASSERT_TRUE(kept) << kept.error().message();
    EXPECT_EQ((*kept)->recipe->recipe.zones.size(), 2U);
    std::size_t at = whole.size();
    for (const int zones : {1, 0}) {
        at = whole.rfind("\n[[zone]]", at - 1);
        std::ofstream(file) << whole.substr(0, at);
        const auto cut = remembered_recipe(file, configured);
        ASSERT_FALSE(cut) << zones;
        EXPECT_THAT(cut.error().what,
                    HasSubstr(fmt::format("it has {} of the 2 zones of the configured recipe", zones)));
        EXPECT_TRUE(fs::exists(damaged_recipe(file)));
    }
    in_use.recipe.zones.clear();
    in_use.recipe.name = "another of the folder";
    write_without_checksums(in_use);
    EXPECT_TRUE(remembered_recipe(file, configured)) << "another recipe may have no zone";
}

TEST_F(RecipeInUseFile, without_checksum_of_another_name_is_compared_with_the_recipe_that_was_selected) {
    const fs::path recipes = folder.path() / "recipes", selected = recipes / "seven.toml";
    fs::create_directory(recipes);
    NumberedRecipe other{.number = 7};
    other.recipe.name = "another of the folder";
    algo::Zone zone;
    zone.centre = {4, 4};
    zone.radius = 3;
    other.recipe.zones.assign(2, zone);
    std::ofstream(selected) << format_recipe(other);
    write_without_checksums(other);
    const std::string whole = text_of(file), cut = whole.substr(0, whole.rfind("\n[[zone]]"));
    EXPECT_TRUE(remembered_recipe(file, configured, recipes));
    std::ofstream(file) << cut;
    const auto refused = remembered_recipe(file, configured, recipes);
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().what, HasSubstr("it has 1 of the 2 zones of recipe 7 in " + recipes.string()));
    // Of a recipe that the folder does not have any more nobody knows what it had.
    fs::remove(selected);
    std::ofstream(file) << cut;
    EXPECT_TRUE(remembered_recipe(file, configured, recipes));
}

TEST_F(RecipeInUseFile, that_is_a_broken_link_is_set_aside) {
    fs::create_symlink("nowhere", file);
    const auto kept = remembered_recipe(file, configured);
    ASSERT_FALSE(kept);
    EXPECT_THAT(kept.error().what, HasSubstr("is damaged (it is no regular file) and was renamed"));
    EXPECT_FALSE(fs::is_symlink(file));
    EXPECT_TRUE(fs::is_symlink(damaged_recipe(file)));
    ASSERT_TRUE(remember_recipe(file, crc32_of(configured), configured)) << "the cure works";
}

}  // namespace
}  // namespace hord::firmware
