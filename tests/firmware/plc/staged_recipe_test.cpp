// A PLC changes the recipe in use by its registers: taken as they were read back, or refused with the registers' names.
#include "firmware/plc/staged_recipe.h"

#include <cmath>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/firmware/plc/plc_commands.h"

namespace hord::firmware {
namespace {

using modbus::Exception;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

TEST_F(PlcCommands, staged_limits_are_judged_with_once_committed_and_what_registers_do_not_say_stays) {
    open();
    ready();
    EXPECT_EQ(write(8202, {12, 800}), Exception::none);
    EXPECT_EQ(command(Command::commit_recipe, 0xBAD), CommandError::wrong_checksum);
    EXPECT_EQ(operations.recipe().number, 3);
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::none);
    EXPECT_EQ(inspector.number, 12);
    EXPECT_FLOAT_EQ(operations.recipe().recipe.emd_limit_bins, 0.8F);
    EXPECT_EQ(operations.recipe().recipe.zones.size(), 1U);
    EXPECT_EQ(read32(8027), crc32_of(operations.recipe()));  // the reply's result
    const auto change = std::find_if(notes.changes.begin(), notes.changes.end(),
                                     [](const Change& c) { return c.what == Change::What::recipe; });
    ASSERT_NE(change, notes.changes.end());
    EXPECT_EQ(change->who.peer, "192.0.2.7:50123");
    EXPECT_EQ(change->who.token, token);
    EXPECT_THAT(change->before, HasSubstr("number = 3"));
    EXPECT_THAT(change->after, HasSubstr("emd_bins = 0.8"));
}

TEST_F(PlcCommands, a_recipe_that_cannot_be_used_is_refused_as_a_whole_and_the_old_one_stays) {
    open();
    ready();
    const std::string before = format_recipe(operations.recipe());
    for (const Words& bad :
         {Words{12, 0}, Words{12, 1000, 400, 1000}, Words{12, 1000, 400, 700, 0}, Words{12, 800, 400, 700, 1, 200}}) {
        EXPECT_EQ(write(8202, bad), Exception::none);
        EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::bad_argument);
        EXPECT_EQ(format_recipe(operations.recipe()), before);
    }
    EXPECT_EQ(inspector.number, 0);
    EXPECT_EQ(troubles.size(), 4U);
}

TEST_F(PlcCommands, a_refused_commit_names_each_register_whose_value_cannot_be_used_and_its_range) {
    open();
    ready();
    EXPECT_EQ(write(8203, {60000}), Exception::none);
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::bad_argument);
    EXPECT_EQ(remarks(), "8203 staged_emd_limit: limits.emd_bins: 60 is out of range: use 0.001 to 30");
    EXPECT_EQ(troubles.back(), remarks()) << "the journal says the same";
    EXPECT_EQ(write(8206, {0}), Exception::none);
    EXPECT_EQ(write(8209, {20000}), Exception::none);
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::bad_argument);
    EXPECT_THAT(troubles.back(), StartsWith("8203, 8206, 8209 cannot be used; 8203 staged_emd_limit: "));
    EXPECT_THAT(troubles.back(),
                HasSubstr("; 8206 staged_min_area: limits.min_area: 0 is out of range: use 1 to 65534; "));
    EXPECT_THAT(troubles.back(), HasSubstr("; 8209 staged_min_lit_share: light.min_lit_share: 2 is out of range"));
    EXPECT_EQ(remarks(), troubles.back().substr(0, 107) + "... (journal)");
    EXPECT_EQ(write(8203, {1000, 400, 700, 1, 0xFFFF, 200, 500}), Exception::none);
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::none);
    EXPECT_EQ(remarks(), "");
}

TEST_F(PlcCommands, a_refused_commit_names_the_registers_that_do_not_fit_the_light_field) {
    open();
    ready();
    EXPECT_EQ(write(8206, {65}), Exception::none);
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::bad_argument);
    EXPECT_EQ(remarks(), "8206 staged_min_area: min_area must be at most the number of lenslets, 64");
    EXPECT_EQ(write(8206, {64, 4}), Exception::none);
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::bad_argument);
    EXPECT_EQ(remarks(),
              "8207 staged_rim_margin: rim_margin 4 leaves nothing of a field of 8x8 lenslets to judge: use at most 3");
    EXPECT_EQ(write(8203, {0, 0, 999, 0, 4, 10'001, 10'001}), Exception::none);
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::bad_argument);
    EXPECT_THAT(remarks(), StartsWith("8203, 8204, 8206, 8207, 8208, 8209 cannot be used; 8203 staged_emd_limit: "));
    EXPECT_EQ(write(8203, {1000, 400, 1000, 64, 3, 200, 500}), Exception::none);
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::bad_argument);
    EXPECT_EQ(remarks(), "8205 staged_transmission_limit: limits.transmission: 1 is out of range: use 0 to 0.999");
    EXPECT_EQ(write(8205, {999}), Exception::none);
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::none);
    EXPECT_EQ(operations.recipe().recipe.min_area, 64U);
}

// The register map says these ranges; the field of the tests has 8x8 lenslets.
TEST_F(PlcCommands, each_staged_register_takes_its_range_and_nothing_beyond) {
    struct Range {
        std::uint16_t address, first, last;
        std::vector<std::uint16_t> beyond;
    };
    const std::vector<Range> ranges{{8202, 0, 65534, {}},           {8203, 1, 30'000, {0, 30'001}},
                                    {8204, 1, 30'000, {0, 30'001}}, {8205, 0, 999, {1000, 65534}},
                                    {8206, 1, 64, {0, 65}},         {8207, 0, 3, {4, 0xFFFE}},
                                    {8208, 0, 10'000, {10'001}},    {8209, 0, 10'000, {10'001}}};
    open();
    ready();
    const auto commit = [&](std::uint16_t address, std::uint16_t value) {
        EXPECT_EQ(write(address, {value}), Exception::none);
        return command(Command::commit_recipe, read32(8210));
    };
    for (const Range& range : ranges) {
        const std::uint16_t was = read(range.address, 1)[0];
        for (const std::uint16_t value : range.beyond) {
            EXPECT_EQ(commit(range.address, value), CommandError::bad_argument) << range.address << ": " << value;
            EXPECT_THAT(remarks(), StartsWith(std::to_string(range.address) + " ")) << value;
        }
        for (const std::uint16_t value : {range.first, range.last, was})
            EXPECT_EQ(commit(range.address, value), CommandError::none) << range.address << ": " << value;
    }
}

TEST_F(PlcCommands, the_limit_of_a_feature_that_is_not_judged_is_not_available_and_cannot_be_given) {
    open();
    ready();
    EXPECT_EQ(command(Command::use_recipe, 88), CommandError::none);
    EXPECT_THAT(read(8203, 3), ElementsAre(0xFFFF, 0xFFFF, 700));
    // Limits of judged features can be changed; the others stay "not available", also if that is written back.
    EXPECT_EQ(write(8203, {0xFFFF, 0xFFFF, 800}), Exception::none);
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::none);
    EXPECT_FLOAT_EQ(operations.recipe().recipe.transmission_limit, 0.8F);
    EXPECT_FALSE(operations.recipe().recipe.gradient);
    const std::string before = format_recipe(operations.recipe());
    const algo::Recipe usual;
    for (const double limit : {0.5, double{usual.emd_limit_bins}, double{usual.frobenius_limit_bins}}) {
        for (const std::uint16_t address : std::vector<std::uint16_t>{8203, 8204}) {
            EXPECT_EQ(write(8203, {0xFFFF, 0xFFFF}), Exception::none);
            EXPECT_EQ(write(address, {static_cast<std::uint16_t>(std::lround(limit * 1000))}), Exception::none);
            EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::bad_argument) << limit;
            EXPECT_EQ(format_recipe(operations.recipe()), before);
            EXPECT_EQ(remarks(),
                      fmt::format("{} staged_{}_limit: the recipe does not judge by it: write 65535, or name it in the "
                                  "recipe's features",
                                  address, address == 8203 ? "emd" : "frobenius"));
        }
    }
}

TEST_F(PlcCommands, a_limit_of_65535_is_the_recipes_own) {
    open();
    ready();
    const NumberedRecipe before = operations.recipe();
    EXPECT_EQ(write(8202, {12, 0xFFFF, 0xFFFF, 0xFFFF, 2}), Exception::none);
    EXPECT_EQ(command(Command::commit_recipe, read32(8210)), CommandError::none);
    NumberedRecipe expected = before;
    expected.number = 12;
    expected.recipe.min_area = 2;
    EXPECT_EQ(format_recipe(operations.recipe()), format_recipe(expected));
    EXPECT_THAT(read(8203, 3), ElementsAre(1000, 400, 700)) << "what is in use now";
}

TEST(StagedRecipe, shows_the_nearest_value_that_a_register_can_have) {
    NumberedRecipe numbered{.number = 9};
    numbered.recipe.emd_limit_bins = 70;
    numbered.recipe.frobenius_limit_bins = 0.0006F;
    numbered.recipe.transmission_limit = 0.0004F;
    numbered.recipe.min_area = 70'000;
    numbered.recipe.max_saturated_share = 0.99996F;
    const StagedRecipe staged = staged_from(numbered);
    EXPECT_EQ(staged.emd_limit_mbins, 0xFFFE);
    EXPECT_EQ(staged.frobenius_limit_mbins, 1);
    EXPECT_EQ(staged.transmission_permille, 0);
    EXPECT_EQ(staged.min_area, 0xFFFE);
    EXPECT_EQ(staged.max_saturated_permyriad, 10'000);
    EXPECT_EQ(with_staged(numbered, staged).recipe.emd_limit_bins, 70) << "what was not changed keeps its digits";
}

// 300x300 lenslets: a file may give an area that no register holds, and a PLC may change the other limits beside it.
TEST(StagedRecipe, the_range_of_an_area_is_that_of_its_register_and_of_the_file_where_it_was_not_changed) {
    const algo::Extents field{.m = 300, .n = 300, .i = 3, .j = 3};
    NumberedRecipe in_use{.number = 9};
    in_use.recipe.min_area = 70'000;
    StagedRecipe staged = staged_from(in_use);
    staged.emd_limit_mbins = 60'000;
    EXPECT_EQ(bad_registers(in_use, staged, field),
              "8203 staged_emd_limit: limits.emd_bins: 60 is out of range: use 0.001 to 30");
    staged.emd_limit_mbins = 800;
    EXPECT_EQ(bad_registers(in_use, staged, field), "");
    staged.min_area = 0xFFFF;
    EXPECT_EQ(bad_registers(in_use, staged, field),
              "8206 staged_min_area: limits.min_area: 65535 is out of range: use 1 to 65534");
    staged.min_area = 0;
    EXPECT_EQ(bad_registers(in_use, staged, field),
              "8206 staged_min_area: limits.min_area: 0 is out of range: use 1 to 65534");
}

}  // namespace
}  // namespace hord::firmware
