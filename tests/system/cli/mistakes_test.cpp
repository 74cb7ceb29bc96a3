// What the programs say of mistakes on the command line, of blank files and of output that cannot be written.
#include <algorithm>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;

TEST(Mistakes, output_that_does_not_reach_its_disk_is_an_error) {
    const TemporaryFolder folder;
    std::ofstream(folder / "c.toml") << simulated_beside("");
    const std::string check = "hordd --check --config " + (folder / "c.toml");
    const char* const commands[] = {"hordctl registers", "hordctl registers --format json",
                                    "hordctl --help",    "hord-lab --version",
                                    "hordd --catalog",   check.c_str()};
    for (const char* command : commands) {
        const Said said = run("/bin/sh", {"-c", "\"$0\"/" + std::string(command) + " >/dev/full", HORD_BIN_DIR});
        EXPECT_EQ(said.status, 2) << command << said.err;
        EXPECT_THAT(said.err, HasSubstr("the output could not be written")) << command;
    }
}

TEST(Mistakes, a_blank_file_is_refused_and_named) {
    const TemporaryFolder folder;
    std::ofstream(folder / "good.toml") << simulated_beside("[inspection]\nrecipe = \"blank.toml\"\n");
    const std::string blank = folder / "blank.toml";
    for (const char* text : {"", " \n\n"}) {
        std::ofstream(blank) << text;
        for (const auto& [program, arguments] : std::vector<std::pair<std::string, std::vector<std::string>>>{
                 {"hordd", {"--check", "--config", blank}},
                 {"hordd", {"--check", "--config", folder / "good.toml"}},
                 {"hord-safe", {"--config", blank}},
                 {"hord-page", {"--check", "--config", blank}},
                 {"hord-mqtt", {"--check", "--config", blank}},
                 {"hordctl", {"recipe", "check", blank}},
                 {"hordctl", {"recipe", "seal", blank}},
                 {"hord-lab", {"render", blank, "--out", folder / "o.png"}}}) {
            const Said said = run(program, arguments);
            EXPECT_TRUE(said.status == 2 || said.status == 78) << program << " " << said.status;
            EXPECT_THAT(said.err, HasSubstr("blank.toml: is empty: write it again, or remove it")) << program;
        }
    }
}

TEST(Mistakes, on_the_command_line_are_named) {
    const auto refused = [](const std::vector<std::string>& arguments, const std::string& what) {
        const Said said = run("hordctl", arguments);
        EXPECT_EQ(said.status, 2) << what;
        EXPECT_THAT(said.err, HasSubstr(what));
        EXPECT_LT(said.err.size(), 700U) << "one line, without limits of 300 digits";
        EXPECT_EQ(std::ranges::count(said.err, '\n'), 1) << said.err;
    };
    refused({"recipe", "chek"}, "\"chek\" is not known");
    refused({"run", "--simulate", "--seed", "010"}, "010 begins with 0");
    refused({"latency", "--simulate", "--edges", "010"}, "010 begins with 0");
    refused({"inspect", "none.png", "--macro", "4294967305x9"}, "--macro 4294967305x9 is not a macro-pixel size");
    refused({"results", "--last", "0"}, "--last: 0 is not above 0");
    refused({"results", "--reason", "verdict-lat"}, "no reason is called \"verdict-lat\"");
    refused({"tune", "--good", "a", "--bad", "b", "--budget", "-1"}, "--budget: -1 is not above 0");
    refused({"watch", "--count", "-1"}, "--count");
}

}  // namespace
}  // namespace hord::test
