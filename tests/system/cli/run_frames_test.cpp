// hordctl run on recorded frames: a reader of its lines that goes away, and options that would have no effect.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>

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
    void configure(const std::string& sensor, int max_failures_in_a_row = 0) {
        std::ofstream(folder / "c.toml") << simulated_beside(
            sensor + "[modbus]\nport = 0\n[station]\nmax_failures_in_a_row = " + std::to_string(max_failures_in_a_row) +
            "\n" + kRoomyLine);
    }
    static constexpr int kFrames = 6;
    TemporaryFolder folder;
};

// A pipe that takes nothing: it is full, and nobody reads.
class FullPipe {
  public:
    FullPipe() {
        EXPECT_EQ(::pipe(ends_), 0);
        const auto size = static_cast<std::size_t>(::fcntl(ends_[1], F_GETPIPE_SZ));
        EXPECT_EQ(::write(ends_[1], std::string(size, ' ').data(), size), static_cast<ssize_t>(size));
    }
    FullPipe(const FullPipe&) = delete;
    FullPipe& operator=(const FullPipe&) = delete;
    ~FullPipe() {
        ::close(ends_[0]);
        ::close(ends_[1]);
    }
    // Other programs open it by this name.
    [[nodiscard]] std::string path() const {
        return "/proc/" + std::to_string(::getpid()) + "/fd/" + std::to_string(ends_[1]);
    }

  private:
    int ends_[2] = {-1, -1};
};

TEST_F(RunFrames, with_a_report_that_stderr_does_not_take_ends_with_a_status_that_says_so) {
    for (const auto& [to, status] : {std::pair("/dev/full", 2), {"/dev/null", 0}}) {
        const Said said = run("/bin/sh",
                              {"-c", "exec \"$0\" run --json --config \"$1\" 2>" + std::string(to),
                               std::string(HORD_BIN_DIR) + "/hordctl", folder / "c.toml"});
        EXPECT_EQ(said.status, status) << to;
        EXPECT_EQ(std::count(said.out.begin(), said.out.end(), '\n'), kFrames) << to;
    }
}

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

TEST_F(RunFrames, goes_on_when_the_reader_of_its_lines_takes_nothing) {
    const FullPipe unread;
    const Said said = run("/bin/bash",
                          {"-c",
                           std::string(HORD_BIN_DIR) + "/hordctl run --rate 2 --json --config " + (folder / "c.toml") +
                               " >" + unread.path()});
    EXPECT_EQ(said.status, 2) << said.err;
    EXPECT_THAT(said.err, HasSubstr("the lines from part 1 on could not be written (their reader does not take them)"));
    EXPECT_THAT(said.err, HasSubstr("seen " + std::to_string(kFrames) + " "));
}

// The pipe is full from the first line on, and its reader ends while the station runs or waits for it.
TEST_F(RunFrames, names_the_first_part_whose_line_waits_when_the_reader_ends) {
    const Said said = run("/bin/bash",
                          {"-c",
                           "{ head -c 65536 /dev/zero; " + std::string(HORD_BIN_DIR) +
                               "/hordctl run --rate 2 --json --config " + (folder / "c.toml") + "; } > >(sleep 4)"});
    EXPECT_EQ(said.status, 2) << said.err;
    EXPECT_THAT(said.err, HasSubstr("the lines from part 1 on could not be written ("));
    EXPECT_THAT(said.err, HasSubstr("seen " + std::to_string(kFrames) + " "));
}

// Results are stored and devices closed before the report is written, and that waits 2 s.
TEST_F(RunFrames, ends_when_the_reader_of_its_report_takes_nothing) {
    const FullPipe unread;
    const Said said = run(
        "/bin/bash",
        {"-c",
         std::string(HORD_BIN_DIR) + "/hordctl run --rate 2 --config " + (folder / "c.toml") + " >" + unread.path()});
    EXPECT_EQ(said.status, 2) << said.err;
    EXPECT_THAT(said.err, HasSubstr("the report could not be written: its reader does not take it"));
}

// The station's own thread writes messages: it must time the line, answer the registers and end all the same.
TEST_F(RunFrames, goes_on_and_ends_when_nobody_takes_its_messages) {
    const FullPipe unread;
    const Said said = run(
        "/bin/bash",
        {"-c",
         std::string(HORD_BIN_DIR) + "/hordctl run --rate 2 --config " + (folder / "c.toml") + " 2>" + unread.path()});
    EXPECT_EQ(said.status, 0);
    EXPECT_THAT(said.out, HasSubstr("seen " + std::to_string(kFrames) + " "));
    std::filesystem::create_directories(folder / "state");
    const Said service = run("/bin/bash",
                             {"-c",
                              "STATE_DIRECTORY=" + (folder / "state") + " " + HORD_BIN_DIR + "/hordd --config " +
                                  (folder / "c.toml") + " 2>" + unread.path() + " & sleep 2; kill -TERM $!; wait $!"});
    EXPECT_EQ(service.status, 0);
}

// Dark frames are no verdict, and two of them in a row stop the station: its line brings no further frame.
TEST_F(RunFrames, ends_with_the_report_when_the_station_is_in_error) {
    configure("[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n", 2);
    const Said said = run("hordctl", {"run", "--rate", "2", "--config", folder / "c.toml"}, std::chrono::seconds(60));
    EXPECT_EQ(said.status, 3) << said.err;
    EXPECT_THAT(said.out, HasSubstr("the station ended in Error"));
    EXPECT_THAT(said.out, HasSubstr("too-dark"));
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
