// `hord-lab experiment` as a person meets it.
#include <algorithm>
#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;

TEST(Experiment, help_lists_what_can_be_asked_and_how_long_it_takes) {
    const Said list = run("hord-lab", {"experiment", "--help"});
    EXPECT_EQ(list.status, 0);
    EXPECT_THAT(list.out, HasSubstr("paper"));
    const Said one = run("hord-lab", {"experiment", "paper", "--help"});
    EXPECT_EQ(one.status, 0);
    EXPECT_THAT(one.out, HasSubstr("The full form takes"));
    EXPECT_THAT(one.out, HasSubstr("Example: hord-lab experiment paper --out"));
}

TEST(Experiment, a_wrong_command_line_or_folder_is_status_2_and_one_line) {
    const TemporaryFolder folder;
    const std::vector<std::vector<std::string>> wrong = {{"experiment"},
                                                         {"experiment", "paper"},
                                                         {"experiment", "no-such", "--out", folder / "x"},
                                                         {"experiment", "paper", "--out", "/dev/null/x", "--quick"}};
    for (const auto& arguments : wrong) {
        const Said said = run("hord-lab", arguments);
        EXPECT_EQ(said.status, 2) << arguments.back();
        EXPECT_EQ(std::count(said.err.begin(), said.err.end(), '\n'), 1) << said.err;
        EXPECT_TRUE(said.out.empty()) << said.out;
    }
}

TEST(Experiment, of_which_nothing_is_finished_reports_nothing_and_computes_nothing) {
    const TemporaryFolder folder;
    const Said said = run("hord-lab", {"experiment", "detection", "--out", folder / "x", "--quick", "--finished"});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("no figure is finished: let the experiment run on"));
    EXPECT_FALSE(std::filesystem::exists(folder / "x/detection.md"));
}

}  // namespace
}  // namespace hord::test
