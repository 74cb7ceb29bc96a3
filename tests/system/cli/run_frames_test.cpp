// hordctl run on recorded frames: a reader of its lines that goes away, and options that would have no effect.
#include <filesystem>
#include <fstream>
#include <string>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "drivers/files/frame_file.h"
#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;

class RunFrames : public ::testing::Test {
  protected:
    RunFrames() {
        std::filesystem::create_directories(folder / "frames");
        for (int k = 0; k < kFrames; ++k)
            EXPECT_TRUE(
                drivers::write_frame(folder / ("frames/" + std::to_string(k) + ".png"), Frame(27, 27, 8).view()));
        configure("[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n");
    }
    void configure(const std::string& sensor) {
        std::ofstream(folder / "c.toml") << simulated_beside(
            sensor + "[modbus]\nport = 0\n[station]\nmax_failures_in_a_row = 0\n" + kRoomyLine);
    }
    static constexpr int kFrames = 6;
    TemporaryFolder folder;
};

TEST_F(RunFrames, inspects_every_part_when_its_lines_cannot_be_written_and_says_so_once) {
    for (const auto& [out, why] : {std::pair<std::string, std::string>{">/dev/full", "No space left on device"},
                                   {"> >(head -n 1 >/dev/null)", "Broken pipe"}}) {
        const Said said = run(
            "/bin/bash",
            {"-c",
             std::string(HORD_BIN_DIR) + "/hordctl run --rate 2 --json --config " + (folder / "c.toml") + " " + out});
        EXPECT_EQ(said.status, 2) << said.err;
        EXPECT_THAT(said.err, HasSubstr(" could not be written (" + why + "): inspection goes on")) << out;
        EXPECT_THAT(said.err, HasSubstr("seen " + std::to_string(kFrames) + " ")) << out;
        const auto first = said.err.find("inspection goes on");
        EXPECT_EQ(said.err.find("inspection goes on", first + 1), std::string::npos) << "told once\n" << said.err;
    }
}

// The pipe takes one line of a part at most: it is nearly full before the run, and nobody reads.
TEST_F(RunFrames, goes_on_when_the_reader_of_its_lines_takes_nothing) {
    int ends[2];
    ASSERT_EQ(::pipe(ends), 0);
    const std::string out = "/proc/" + std::to_string(::getpid()) + "/fd/" + std::to_string(ends[1]);
    const int size = ::fcntl(ends[1], F_SETPIPE_SZ, 4096);
    ASSERT_EQ(size, 4096);
    ASSERT_EQ(::write(ends[1], std::string(4096, ' ').data(), 4096), 4096);
    const Said said =
        run("/bin/bash",
            {"-c",
             std::string(HORD_BIN_DIR) + "/hordctl run --rate 2 --json --config " + (folder / "c.toml") + " >" + out});
    EXPECT_EQ(said.status, 2) << said.err;
    EXPECT_THAT(said.err, HasSubstr("the last lines could not be written: their reader does not take them"));
    EXPECT_THAT(said.err, HasSubstr("seen " + std::to_string(kFrames) + " "));
    ::close(ends[0]);
    ::close(ends[1]);
}

TEST_F(RunFrames, options_that_would_have_no_effect_are_refused_with_the_reason) {
    const auto refused = [&](const std::string& option, const std::string& value, const std::string& why) {
        const Said said = run("hordctl", {"run", "--config", folder / "c.toml", "--parts", "1", option, value});
        EXPECT_EQ(said.status, 2) << option;
        EXPECT_EQ(said.err, "hordctl: " + option + " has no effect: " + why + ": leave it out\n");
    };
    const std::string frames = "the frames are those of " + (folder / "frames");
    refused("--good", "0.5", frames);
    refused("--variety", "2", frames);
    configure("[sensor]\nbackend = \"v4l2\"\n");
    refused("--variety", "2", "the frames come from a camera (sensor.backend)");
    configure("[sensor]\nbackend = \"simulated\"\nscenes = \"frames\"\n");
    refused("--variety", "2", "the parts are the scenes of " + (folder / "frames"));
}

}  // namespace
}  // namespace hord::test
