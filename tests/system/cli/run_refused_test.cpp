// What `hordctl run` refuses, and what it does without a device.
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/system/cli/program.h"
#include "tests/system/cli/station_fixture.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;

TEST(Run, refuses_a_port_that_is_taken_and_names_it) {
    const HeldPort taken(true);
    const std::string port = std::to_string(taken.port());
    const TemporaryFolder folder;
    std::ofstream(folder / "c.toml") << "[modbus]\nread_only_port = " + port + "\n";
    for (const std::vector<std::string>& where : {std::vector<std::string>{"--modbus", taken.address()},
                                                  {"--modbus", "127.0.0.1:0", "--config", folder / "c.toml"}}) {
        std::vector<std::string> args{"run", "--simulate", "--parts", "1"};
        args.insert(args.end(), where.begin(), where.end());
        const Said said = run("hordctl", args);
        EXPECT_EQ(said.status, 2);
        EXPECT_THAT(said.err, HasSubstr(port));
    }
}

TEST(Run, refuses_to_guess_its_devices) {
    const Said said = run("hordctl", {"run", "--modbus", "127.0.0.1:0"});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("neither --config nor --simulate is given: give --config FILE"));
    EXPECT_THAT(said.err, testing::Not(HasSubstr("render parts")));
}

TEST(Run, refuses_a_configuration_with_every_problem_at_once) {
    const TemporaryFolder folder;
    std::ofstream(folder / "c.toml") << "[line]\ntransport_mss = 4\n[modbus]\nport = 99999999\n";
    const Said said = run("hordctl", {"run", "--config", folder / "c.toml", "--parts", "1"});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("c.toml:2"));
    EXPECT_THAT(said.err, HasSubstr("c.toml:4"));
}

// Parts also come without the rejector: they are counted, and none is judged good.
TEST(Run, without_its_rejector_no_part_is_passed_and_the_line_is_stopped) {
    const TemporaryFolder folder;
    const HeldPort absent(false), silent(true);
    for (const int port : {absent.port(), silent.port()}) {
        std::ofstream(folder / "c.toml") << simulated_beside(
            "[rejector]\nbackend = \"modbus\"\nport = " + std::to_string(port) + "\n[modbus]\nport = 0\n");
        const Said said =
            run("hordctl", {"run", "--config", folder / "c.toml", "--variety", "1", "--parts", "5", "--json"});
        EXPECT_EQ(said.status, 3) << said.err;
        const auto parts = json_lines(said.out);
        EXPECT_EQ(parts.size(), 5U) << said.err;
        for (const Json& part : parts) {
            EXPECT_NE(part["verdict"], "pass") << part;
            EXPECT_TRUE(part["ejected"].is_null()) << part;  // the simulated line does not see a real ejector
        }
        EXPECT_THAT(said.err, HasSubstr(std::to_string(port)));
        EXPECT_THAT(said.err, testing::Not(HasSubstr("by the right way")));
    }
}

TEST(Run, recorded_frames_get_the_verdicts_that_inspect_gives) {
    const auto data = real_data() / "povray";
    if (!std::filesystem::is_directory(data))
        GTEST_SKIP() << "no real input: set HORD_DATA, or put it at ../shared/data";
    const TemporaryFolder folder;
    std::filesystem::create_directories(folder / "frames");
    std::vector<std::string> arguments{"inspect", "--json"};
    for (const std::string name : {"bubble_r500_111", "cutout_111", "empty_111", "lens_111", "wedge_111"}) {
        const std::string file = folder / ("frames/" + name + ".png");
        std::filesystem::copy_file(data / (name + "_raw.png"), file);
        arguments.push_back(file);
    }
    const auto inspected = json_lines(run("hordctl", arguments).out);
    std::ofstream(folder / "c.toml") << simulated_beside(
        std::string("[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n[modbus]\nport = 0\n") + kRoomyLine);
    const Said said = run("hordctl", {"run", "--config", folder / "c.toml", "--rate", "2", "--json"});
    const auto played = json_lines(said.out);
    ASSERT_EQ(inspected.size(), 5U);
    ASSERT_EQ(played.size(), 5U) << said.err;
    for (std::size_t k = 0; k < played.size(); ++k) {
        EXPECT_EQ(played[k]["verdict"], inspected[k]["verdict"]) << played[k] << said.err;
        EXPECT_EQ(played[k]["reason"], inspected[k]["reason"]);
        EXPECT_EQ(played[k]["ejected"], inspected[k]["verdict"] != "pass");
    }
}

TEST(Run, refuses_a_folder_of_frames_with_a_bad_one_and_names_it) {
    const TemporaryFolder folder;
    std::filesystem::create_directories(folder / "frames");
    std::ofstream(folder / "frames/a.png") << "not an image";
    std::ofstream(folder / "c.toml") << simulated_beside(
        "[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n[modbus]\nport = 0\n");
    const Said said = run("hordctl", {"run", "--config", folder / "c.toml"});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("a.png"));
}

}  // namespace
}  // namespace hord::test
