// deploy/boards: the example configuration of each board, as hordd reads it.
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const fs::path kDeploy = fs::path(HORD_SOURCE_DIR) / "deploy";

std::string text_of(const fs::path& file) {
    std::ifstream in(file);
    return {std::istreambuf_iterator<char>(in), {}};
}
std::vector<fs::path> examples() {
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(kDeploy / "boards")) {
        if (entry.path().extension() == ".toml") files.push_back(entry.path());
    }
    return files;
}

TEST(Boards, every_example_passes_the_check_as_it_is) {
    ASSERT_FALSE(examples().empty());
    for (const fs::path& file : examples()) {
        const Said said = run("hordd", {"--check", "--config", file.string()});
        EXPECT_EQ(said.status, 0) << file << said.out << said.err;
        EXPECT_THAT(said.out + said.err, testing::Not(HasSubstr("simulated"))) << file;
    }
}

TEST(Boards, an_example_with_a_line_that_is_wrong_does_not_pass) {
    const TemporaryFolder folder;
    for (const fs::path& file : examples()) {
        std::string text = text_of(file);
        const std::string section = "[part_sensor]\n";
        const std::size_t at = text.find(section);
        ASSERT_NE(at, std::string::npos) << file;
        text.insert(at + section.size(), "chips = 1\n");
        std::ofstream(folder / "wrong.toml") << text;
        const Said said = run("hordd", {"--check", "--config", folder / "wrong.toml"});
        EXPECT_NE(said.status, 0) << file;
        EXPECT_THAT(said.err + said.out, HasSubstr("chips"));
    }
}

// The list of the page, the package and the folder are the same files.
TEST(Boards, the_page_and_the_package_have_every_example) {
    const std::string page = text_of(kDeploy / "boards/README.md"), package = text_of(kDeploy / "CMakeLists.txt");
    for (const fs::path& file : examples()) {
        const std::string name = file.filename().string();
        EXPECT_THAT(page, HasSubstr("](" + name + ")"));
        EXPECT_THAT(package, HasSubstr("boards/" + name));
    }
}

TEST(Boards, the_trial_with_a_genicam_camera_passes_the_check_and_is_on_the_page) {
    const Said said = run("hordd", {"--check", "--config", (kDeploy / "try-genicam.toml").string()});
    EXPECT_EQ(said.status, 0) << said.out << said.err;
    EXPECT_THAT(text_of(kDeploy.parent_path() / "docs/hardware.md"), HasSubstr("(../deploy/try-genicam.toml)"));
}

// A device that an example names must be one that the unit may open.
TEST(Boards, the_unit_may_open_what_small_boards_have) {
    const std::string unit = text_of(kDeploy / "hordd.service");
    for (const char* name : {"gpiochip", "video4linux", "media", "ttyS", "ttyUSB", "ttyAMA", "ttyACM", "dma_heap"})
        EXPECT_THAT(unit, HasSubstr(std::string("\nDeviceAllow=char-") + name + " rw\n"));
    const std::string rules = text_of(kDeploy / "udev.rules");
    EXPECT_THAT(rules, HasSubstr("SUBSYSTEM==\"dma_heap\", GROUP=\"video\""));
    EXPECT_THAT(rules, HasSubstr("*:ef05??:*"));
}

}  // namespace
}  // namespace hord::test
