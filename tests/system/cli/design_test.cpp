// `hord-lab design` as a script meets it. Status 0 and 1 follow lab::meets() (tests/lab/design): a search takes too
// long for a test here.
#include <filesystem>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

TEST(Design, for_which_no_cell_shows_the_part_or_with_a_wrong_command_line_is_status_2) {
    const TemporaryFolder folder;
    for (const auto& [defects, pixels] :
         {std::pair("bubble=0.1", "10k"), std::pair("bubble=0.1", "200k"), std::pair("bubble=0.1", "12x"),
          std::pair("dent=0.1", "200k"), std::pair("bubble=100", "200k")}) {
        const Said said = run("hord-lab",
                              {"design", HORD_SOURCE_DIR "/hal_sim/scenes/lens.toml", "--defects", defects, "--pixels",
                               pixels, "--quick", "--out", folder / "cell"});
        EXPECT_EQ(said.status, 2) << defects << " " << pixels << said.out << said.err;
        EXPECT_FALSE(said.err.empty());
        EXPECT_TRUE(said.out.empty()) << said.out;
        EXPECT_FALSE(std::filesystem::exists(folder / "cell" + "/hordd.toml"));
    }
}

}  // namespace
}  // namespace hord::test
