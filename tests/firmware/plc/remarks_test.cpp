// What `remarks` holds of long texts; and a recipe whose reference was replaced while it was in use.
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/recipes/reference_file.h"
#include "tests/firmware/plc/plc_commands.h"
#include "tests/support/temp_folder.h"

namespace hord::firmware {
namespace {

using modbus::Exception;

TEST_F(PlcCommands, a_long_reason_is_cut_and_its_cure_is_whole) {
    open();
    ready();
    const std::string reason = "/var/lib/hord/" + std::string(100, 'x') + " cannot be written: No space left on device";
    const std::string cure = "check the folder's owner and its disk";
    disk = fail(ErrorCode::io, reason, cure);
    EXPECT_EQ(command(Command::use_recipe, 7), CommandError::failed);
    EXPECT_EQ(remarks(), reason.substr(0, 120 - 5 - cure.size()) + "...: " + cure);
    EXPECT_EQ(troubles.back(), reason + ": " + cure) << "the journal has all";

    // 75 bytes of cure leave 40 of the reason.
    disk = fail(ErrorCode::io, reason, std::string(75, 'c'));
    EXPECT_EQ(command(Command::use_recipe, 7), CommandError::failed);
    EXPECT_EQ(remarks(), reason.substr(0, 40) + "...: " + std::string(75, 'c'));
    disk = fail(ErrorCode::io, reason, std::string(76, 'c'));
    EXPECT_EQ(command(Command::use_recipe, 7), CommandError::failed);
    EXPECT_EQ(remarks(), reason.substr(0, 107) + "... (journal)");
}

algo::Reference reference_of(std::uint32_t parts) {
    algo::Reference r;
    r.extents = {5, 4, 3, 3};
    r.parts = parts;
    r.levels = {6, 60, 255};
    const std::size_t count = r.extents.lenslets();
    r.shares.assign(count * r.stride(), 0);
    for (std::size_t k = 0; k < count; ++k) r.shares[k * r.stride() + r.place(1, 1)] = 30'000;
    for (auto* map : {&r.light, &r.x, &r.y, &r.emd, &r.frobenius}) map->assign(count, 0.25F);
    for (auto& map : r.spread) map.assign(count, 1e-4F);
    r.mask.assign(count, 0);
    return r;
}

// A restart would read the new file, and drop what was committed.
TEST_F(PlcCommands, a_recipe_whose_reference_was_replaced_is_not_committed_and_the_file_is_named) {
    const testing_support::TempFolder folder;
    NumberedRecipe with{.number = 5};
    with.reference_file = folder.path() / "part.hordref";
    ASSERT_TRUE(write_reference(with.reference_file, reference_of(9)));
    with.recipe.reference = *read_reference(with.reference_file);
    open();
    ready();
    ASSERT_TRUE(operations.use({}, with));
    ASSERT_TRUE(write_reference(with.reference_file, reference_of(10)));
    EXPECT_EQ(write(8203, {800}), Exception::none);
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::bad_argument);
    EXPECT_EQ(troubles.back(),
              "recipe 5: its reference " + with.reference_file.string() +
                  " was replaced since it was read: put the old one back, or select the recipe again");
    EXPECT_EQ(kept, 5) << "as it was";
    EXPECT_FLOAT_EQ(operations.recipe().recipe.emd_limit_bins, algo::Recipe{}.emd_limit_bins);
    ASSERT_TRUE(write_reference(with.reference_file, reference_of(9)));
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::none) << "the cure works";
    EXPECT_FLOAT_EQ(operations.recipe().recipe.emd_limit_bins, 0.8F);
}

// The reason of a reference that is of another camera names neither the recipe nor the file.
TEST_F(PlcCommands, a_recipe_that_does_not_fit_the_frames_is_named_with_its_reference) {
    const testing_support::TempFolder folder;
    NumberedRecipe wide{.number = 5};
    wide.recipe.rim_margin = 4;
    wide.reference_file = folder.path() / "part.hordref";
    ASSERT_TRUE(write_reference(wide.reference_file, reference_of(9)));
    wide.recipe.reference = *read_reference(wide.reference_file);
    open();
    ready();
    const auto used = operations.use({}, wide);
    ASSERT_FALSE(used);
    EXPECT_EQ(used.error().code, ErrorCode::invalid_argument);
    EXPECT_EQ(used.error().message(),
              "recipe 5: recipe (its reference: " + wide.reference_file.string() + "): rim_margin or min_area");
}

}  // namespace
}  // namespace hord::firmware
