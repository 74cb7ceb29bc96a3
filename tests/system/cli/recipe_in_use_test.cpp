// The recipe that a service was told to use, over restarts, and what becomes of its file (recipe-in-use.toml).
#include <csignal>
#include <filesystem>
#include <fstream>
#include <regex>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/crc32.h"
#include "common/file_writing.h"
#include "firmware/core/faults.h"
#include "tests/system/cli/service_fixture.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class RecipeInUse : public Service {
  protected:
    // What a life of the service showed and said.
    struct Life {
        int number = -1;
        std::uint32_t faults = 0;
        firmware::CommandError error{};
        std::string said;
    };

    void SetUp() override {
        std::filesystem::create_directories(folder / "recipes");
        std::ofstream(folder / "recipes/seven.toml") << "schema = 1\nname = \"seven\"\nnumber = 7\n";
        write_config("[station]\nautostart = false\n");
    }
    // `use`: the recipe to select; -1: none. The number and the faults are those before it, after it if `after`.
    Life live(int use = -1, bool after = false) {
        Life life;
        Running service("/usr/bin/env", under({"STATE_DIRECTORY=" + folder.path().string()}));
        for (const char* ready : {"Preoperational to Initialized", "registers at"})
            EXPECT_TRUE(service.says(ready, kPatience)) << service.so_far().err;
        auto plc = client_at(port_of(service.so_far()));
        EXPECT_TRUE(plc);
        if (!plc) return life;
        const auto look = [&] {
            const auto words = plc->read(110, 5).value_or(std::vector<std::uint16_t>(5));
            life.number = words[0];
            life.faults = static_cast<std::uint32_t>(words[3]) << 16U | words[4];
        };
        look();
        if (use >= 0) {
            const auto reply = plc->command(firmware::Command::use_recipe, static_cast<std::uint32_t>(use), 0,
                                            std::chrono::seconds(20));
            EXPECT_TRUE(reply);
            if (reply) life.error = reply->error;
        }
        if (after) look();
        EXPECT_EQ(service.stop(SIGTERM).status, 0);
        life.said = service.so_far().err;
        return life;
    }

    const std::filesystem::path kept = folder / "recipe-in-use.toml", damaged = kept.string() + ".damaged";
};

// The start uses the configured one then; who asks before should know.
TEST_F(RecipeInUse, is_told_of_by_check_where_its_file_or_that_of_a_learned_one_is_damaged) {
    const auto check = [&] {
        Said said = run("/usr/bin/env", under({"STATE_DIRECTORY=" + folder.path().string()}, {"--check"}));
        EXPECT_EQ(said.status, 0) << said.err;
        return said.out;
    };
    const std::string note = "note: what was in use or learned cannot be used at the next start: ";
    EXPECT_THAT(check(), Not(HasSubstr(note)));
    for (const std::filesystem::path& file : {kept, folder.path() / "recipe-taught.toml"}) {
        std::ofstream(file) << "half of a recipe";
        EXPECT_THAT(check(), HasSubstr(note + file.string() + " is damaged ("));
        EXPECT_TRUE(std::filesystem::exists(file)) << "it is only looked at";
        std::filesystem::remove(file);
    }
    std::ofstream(damaged) << "renamed by a start";
    EXPECT_THAT(check(), HasSubstr(note + damaged.string() + " was damaged at an earlier start"));
}

TEST_F(RecipeInUse, is_the_one_that_recipe_use_names_if_it_has_the_checksum) {
    std::ofstream(folder / "recipes/eight.toml")
        << "schema = 1\nname = \"eight\"\nnumber = 8\n[limits]\nemd_bins = 2\n";
    const Said sums = run("hordctl", {"recipe", "check", folder / "recipes/seven.toml", folder / "recipes/eight.toml"});
    std::vector<std::string> crcs;
    const std::regex crc("CRC-32 ([0-9A-F]{8})");
    for (std::sregex_iterator at(sums.out.begin(), sums.out.end(), crc), end; at != end; ++at)
        crcs.push_back((*at)[1].str());
    ASSERT_EQ(crcs.size(), 2U) << sums.out << sums.err;
    Running service("/usr/bin/env", under({"STATE_DIRECTORY=" + folder.path().string()}));
    for (const char* ready : {"Preoperational to Initialized", "registers at"})
        ASSERT_TRUE(service.says(ready, kPatience)) << service.so_far().err;
    const std::string address = "127.0.0.1:" + port_of(service.so_far());
    auto plc = client_at(port_of(service.so_far()));
    ASSERT_TRUE(plc);
    const auto use = [&](const std::string& number, const std::string& sum) {
        return run("hordctl", {"recipe", "use", number, "--crc32", sum, "--modbus", address});
    };
    const auto in_use = [&] { return plc->read(110, 1).value_or(std::vector<std::uint16_t>(1)).at(0); };
    EXPECT_EQ(use("8", crcs[1]).status, 0) << service.so_far().err;
    EXPECT_EQ(in_use(), 8);
    const Said other = use("7", crcs[1]);
    EXPECT_EQ(other.status, 2);
    EXPECT_THAT(other.err, HasSubstr("wrong_checksum"));
    EXPECT_EQ(in_use(), 8);
    EXPECT_EQ(use("7", crcs[0]).status, 0);
    EXPECT_EQ(in_use(), 7);
    EXPECT_EQ(service.stop(SIGTERM).status, 0);
}

TEST_F(RecipeInUse, whose_checksum_is_a_folder_is_told_with_the_cure_that_helps) {
    const std::filesystem::path sum = folder / "recipe-in-use.crc32";
    std::filesystem::create_directory(sum);
    const Life life = live(7);
    EXPECT_THAT(life.said,
                HasSubstr(sum.string() +
                          " is a folder, not a regular file: it is not replaced: remove it, "
                          "then commit or select again"));
    EXPECT_EQ(life.error, firmware::CommandError::failed);
    std::filesystem::remove(sum);
    EXPECT_EQ(live(7).error, firmware::CommandError::none);
}

TEST_F(RecipeInUse, remembers_the_recipe_that_was_committed_until_another_is_configured) {
    const std::vector<std::string> arguments = under({"STATE_DIRECTORY=" + folder.path().string()});
    const auto number_in_use = [&](bool switch_to_seven) {
        Running service("/usr/bin/env", arguments);
        EXPECT_TRUE(service.says("registers at", kPatience)) << service.so_far().err;
        auto plc = client_at(port_of(service.so_far()));
        if (!plc) return -1;
        if (switch_to_seven) {
            const auto reply = plc->command(firmware::Command::use_recipe, 7, 0, std::chrono::seconds(20));
            EXPECT_TRUE(reply && reply->error == firmware::CommandError::none) << service.so_far().err;
        }
        const auto number = plc->read(110, 1);
        EXPECT_EQ(service.stop(SIGTERM).status, 0);
        return number ? static_cast<int>(number->at(0)) : -1;
    };
    EXPECT_EQ(number_in_use(false), 0);
    EXPECT_EQ(number_in_use(true), 7);
    EXPECT_EQ(number_in_use(false), 7);
    std::ofstream(folder / "other.toml") << "schema = 1\nname = \"other\"\nnumber = 9\n";
    std::ofstream(folder / "c.toml") << simulated_beside(
        "[inspection]\nmacro = \"3x3\"\nrecipe = \"other.toml\"\n[modbus]\nport = 0\n"
        "[station]\nautostart = false\n");
    EXPECT_EQ(number_in_use(false), 9);
}

TEST_F(RecipeInUse, that_is_damaged_is_set_aside_and_a_fault_until_another_is_selected) {
    EXPECT_EQ(live(7).error, firmware::CommandError::none);
    EXPECT_EQ(live().number, 7);
    std::filesystem::resize_file(kept, std::filesystem::file_size(kept) - 20);
    const std::filesystem::path unfinished = kept.string() + ".0a1b2c3d.new";
    std::ofstream(unfinished) << "what a killed process was writing";
    const Life first = live();
    EXPECT_FALSE(std::filesystem::exists(unfinished));
    EXPECT_EQ(first.number, 0) << "the configured one";
    EXPECT_EQ(first.faults & firmware::kFaultConfiguration, firmware::kFaultConfiguration) << first.said;
    EXPECT_THAT(first.said, HasSubstr(kept.string() + " is damaged ("));
    EXPECT_THAT(first.said, HasSubstr("and was renamed recipe-in-use.toml.damaged: commit or select the recipe again"));
    EXPECT_THAT(first.said, HasSubstr("configuration: the recipe that was in use before the restart cannot be used"));
    EXPECT_TRUE(std::filesystem::exists(damaged));
    const Life second = live(7, true);
    EXPECT_THAT(second.said, HasSubstr(damaged.string() + " was damaged at an earlier start")) << "nobody has acted";
    EXPECT_EQ(second.number, 7);
    EXPECT_EQ(second.faults & firmware::kFaultConfiguration, 0U) << second.said;
    const Life third = live();
    EXPECT_EQ(third.number, 7);
    EXPECT_EQ(third.faults & firmware::kFaultConfiguration, 0U) << third.said;
    EXPECT_THAT(third.said, Not(HasSubstr("damaged")));
}

// Its reference's disk may be mounted late: the file itself is whole.
TEST_F(RecipeInUse, whose_reference_is_gone_is_a_fault_and_its_file_stays) {
    live(7);
    std::string text = common::read_file(kept).value();
    text.resize(text.rfind("# crc32 "));
    text += "[reference]\nfile = \"gone.hordref\"\n";
    text += fmt::format("# crc32 {:08X}\n", common::crc32(text));
    std::ofstream(kept) << text;
    for (int start = 0; start < 2; ++start) {
        const Life life = live();
        EXPECT_EQ(life.number, 0);
        EXPECT_EQ(life.faults & firmware::kFaultConfiguration, firmware::kFaultConfiguration);
        EXPECT_THAT(life.said, HasSubstr("gone.hordref"));
        EXPECT_EQ(common::read_file(kept), text);
    }
}

TEST_F(RecipeInUse, that_is_another_one_than_before_the_restart_is_told_once) {
    live();
    // The same text as with another reference: another content's checksum, and the file's own one to match.
    std::string text = common::read_file(kept).value();
    text.resize(text.rfind("# crc32 "));
    const std::string key = "# Checksum with its reference: ";
    text.replace(text.find(key) + key.size(), 8, "0BADC0DE");
    std::ofstream(kept) << text << fmt::format("# crc32 {:08X}\n", common::crc32(text));
    EXPECT_THAT(live().said, HasSubstr("now, 0BADC0DE then"));
    EXPECT_THAT(live().said, Not(HasSubstr("0BADC0DE")));
}

TEST_F(RecipeInUse, of_an_earlier_version_is_taken_and_gets_its_checksum) {
    live(7);
    std::string text = common::read_file(kept).value();
    text.resize(text.rfind("# crc32 "));
    const auto second_line = text.find('\n') + 1;
    text.erase(second_line, text.find('\n', second_line) + 1 - second_line);
    std::ofstream(kept) << text;
    const Life life = live();
    EXPECT_EQ(life.number, 7);
    EXPECT_EQ(life.faults & firmware::kFaultConfiguration, 0U);
    EXPECT_THAT(life.said, HasSubstr("is of an earlier version and has no checksum"));
    EXPECT_THAT(live().said, Not(HasSubstr("earlier version")));
}

TEST_F(RecipeInUse, that_cannot_be_kept_is_not_taken) {
    live();
    std::filesystem::remove(kept);
    std::filesystem::create_directories(kept / "in the way");
    std::filesystem::create_directories(damaged / "in the way");  // so that it cannot be set aside
    const Life life = live(7, true);
    EXPECT_EQ(life.error, firmware::CommandError::failed);
    EXPECT_EQ(life.number, 0) << "the old recipe stays";
    EXPECT_THAT(life.said,
                HasSubstr(kept.string() + " is a folder, not a regular file: it is not replaced: remove it"));
}

TEST_F(RecipeInUse, that_is_missing_or_no_file_is_a_fault_until_another_is_selected) {
    EXPECT_EQ(live(7).error, firmware::CommandError::none);
    std::filesystem::remove(kept);
    for (int start = 0; start < 2; ++start) {
        const Life life = live();
        EXPECT_EQ(life.number, 0);
        EXPECT_EQ(life.faults & firmware::kFaultConfiguration, firmware::kFaultConfiguration) << life.said;
        EXPECT_THAT(life.said, HasSubstr(kept.string() + " is missing, and the recipe with CRC-32 "));
    }
    EXPECT_EQ(live(7, true).faults & firmware::kFaultConfiguration, 0U);
    EXPECT_THAT(live().said, Not(HasSubstr("is missing")));
    std::filesystem::remove(kept);
    std::filesystem::create_symlink("nowhere", kept);
    const Life link = live(7, true);
    EXPECT_THAT(link.said, HasSubstr("is damaged (it is no regular file)"));
    EXPECT_EQ(link.error, firmware::CommandError::none) << "the cure works";
    EXPECT_EQ(live().number, 7);
    std::filesystem::remove(kept);
    std::filesystem::create_directory(kept);
    std::filesystem::remove(damaged);
    EXPECT_THAT(live().said, HasSubstr("is damaged (it is a folder)"));
    std::filesystem::remove(damaged);
    const Life removed = live();
    EXPECT_EQ(removed.faults & firmware::kFaultConfiguration, 0U) << "the other cure works\n" << removed.said;
}

TEST_F(RecipeInUse, that_is_older_or_configured_otherwise_is_told_once) {
    live();
    const std::string older = common::read_file(kept).value();
    live(7);
    std::ofstream(kept) << older;
    EXPECT_THAT(live().said, HasSubstr("was in use last; the file is an older one"));
    EXPECT_THAT(live().said, Not(HasSubstr("not what was in use")));
    std::ofstream(folder / "other.toml") << "schema = 1\nname = \"other\"\nnumber = 9\n";
    std::ofstream(folder / "c.toml") << simulated_beside(
        "[inspection]\nmacro = \"3x3\"\nrecipe = \"other.toml\"\n[modbus]\nport = 0\n"
        "[station]\nautostart = false\n");
    const Life other = live();
    EXPECT_THAT(other.said, HasSubstr("recipe 9 is not what was in use before the restart"));
    EXPECT_THAT(other.said, HasSubstr("the configured recipe " + (folder / "other.toml") + " has changed since"));
    EXPECT_THAT(live().said, Not(HasSubstr("not what was in use")));
}

// The camera, the calibration or inspection.macro may be another since it was committed.
TEST_F(RecipeInUse, that_does_not_fit_the_light_field_is_a_fault_and_its_file_is_named) {
    live(7);
    std::string text = common::read_file(kept).value();
    text.resize(text.rfind("# crc32 "));
    text = std::regex_replace(text, std::regex("rim_margin = [-0-9]+"), "rim_margin = 60");
    text += fmt::format("# crc32 {:08X}\n", common::crc32(text));
    std::ofstream(kept) << text;
    const Life life = live();
    EXPECT_EQ(life.number, 0) << "the configured one";
    EXPECT_EQ(life.faults & firmware::kFaultConfiguration, firmware::kFaultConfiguration);
    EXPECT_THAT(life.said, HasSubstr(kept.string() + ": recipe \"seven\": rim_margin 60 leaves nothing"));
    EXPECT_EQ(common::read_file(kept), text) << "what it fits may come back";
}

TEST_F(RecipeInUse, that_is_a_link_to_a_good_file_is_used_and_a_commit_says_that_the_link_must_go) {
    live(7);
    std::filesystem::rename(kept, folder / "elsewhere.toml");
    std::filesystem::create_symlink("elsewhere.toml", kept);
    const Life life = live(7);
    EXPECT_EQ(life.number, 7);
    EXPECT_EQ(life.error, firmware::CommandError::failed);
    EXPECT_THAT(life.said,
                HasSubstr(kept.string() +
                          " is a symbolic link, not a regular file: it is not replaced: "
                          "remove it, then commit or select again"));
    std::filesystem::remove(kept);
    EXPECT_EQ(live(7).error, firmware::CommandError::none) << "the cure works";
}

// Another station may have locked the folder that is at the path since.
TEST_F(RecipeInUse, is_not_written_into_another_folder_than_the_locked_one) {
    const std::filesystem::path state = folder / "state", moved = folder / "moved";
    std::filesystem::create_directory(state);
    Running service("/usr/bin/env", under({"STATE_DIRECTORY=" + state.string()}));
    for (const char* ready : {"Preoperational to Initialized", "registers at"})
        ASSERT_TRUE(service.says(ready, kPatience)) << service.so_far().err;
    std::filesystem::rename(state, moved);
    std::filesystem::create_directory(state);
    auto plc = client_at(port_of(service.so_far()));
    ASSERT_TRUE(plc);
    const auto reply = plc->command(firmware::Command::use_recipe, 7, 0, std::chrono::seconds(20));
    ASSERT_TRUE(reply);
    EXPECT_EQ(reply->error, firmware::CommandError::failed);
    EXPECT_TRUE(service.says("configuration: the recipe that was in use before", kPatience)) << service.so_far().err;
    EXPECT_EQ(plc->read(110, 1).value_or(std::vector<std::uint16_t>{9})[0], 0) << "the recipe stays";
    service.stop(SIGTERM);
    EXPECT_THAT(service.so_far().err, HasSubstr(state.string() + " was renamed or removed since the start"));
    for (const char* file : {"recipe-in-use.toml", "line-empty", "station.lock", "teach"})
        EXPECT_FALSE(std::filesystem::exists(state / file)) << file;
}

}  // namespace
}  // namespace hord::test
