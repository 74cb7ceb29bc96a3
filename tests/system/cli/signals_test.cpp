// Signals that end hordd and hordctl run: before the line runs, twice, and behind nohup.
#include <array>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <random>
#include <regex>
#include <string>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/files/frame_file.h"
#include "tests/system/cli/service_fixture.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// Whether the signal is in a set of the process ("SigBlk": it waits, "SigCgt": there is a handler).
bool has(int pid, const std::string& set, int signal) {
    std::ifstream status("/proc/" + std::to_string(pid) + "/status");
    for (std::string line; std::getline(status, line);) {
        if (line.starts_with(set + ":")) return (std::stoull(line.substr(7), nullptr, 16) >> (signal - 1) & 1U) != 0;
    }
    return false;
}

bool waits_until(const std::function<bool()>& holds) {
    const auto until = std::chrono::steady_clock::now() + kPatience;
    while (std::chrono::steady_clock::now() < until) {
        if (holds()) return true;
        std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    return false;
}

// Waits until a signal that would end the program waits for its event loop: it opens its devices then, or runs.
// (Before, a signal is held, or has a handler.)
bool blocks(int pid, int signal) {
    return waits_until([&] { return has(pid, "SigBlk", signal) && has(pid, "SigCgt", signal); });
}

// Waits until the program's own loading is over and it has the signals in hand.
bool holds(int pid, int signal) {
    return waits_until([&] { return has(pid, "SigBlk", signal) || has(pid, "SigCgt", signal); });
}

TEST(Run, ends_in_order_by_a_signal_at_any_moment_of_its_start) {
    std::minstd_rand draw(7);
    for (int k = 0; k < 60; ++k) {
        const int signal = std::array{SIGTERM, SIGINT, SIGQUIT, SIGHUP}.at(static_cast<std::size_t>(k % 4));
        Running line("hordctl", {"run", "--simulate", "--parts", "5", "--seed", "41", "--modbus", "127.0.0.1:0"});
        ASSERT_TRUE(holds(line.pid(), signal)) << line.so_far().err;
        std::this_thread::sleep_for(std::chrono::microseconds(draw() % 60'000));
        const Said said = line.stop(signal);
        EXPECT_EQ(said.status, 0) << "signal " << signal << " of start " << k << "\n" << said.err;
        EXPECT_THAT(said.err, HasSubstr("hordctl: stopped as asked, before the line ran: no part came\n"));
    }
}

TEST_F(Service, ends_in_order_by_a_signal_at_any_moment_of_its_start) {
    write_config("[station]\nautostart = false\n");
    std::minstd_rand draw(11);
    for (int k = 0; k < 60; ++k) {
        const int signal = std::array{SIGTERM, SIGINT, SIGQUIT}.at(static_cast<std::size_t>(k % 3));
        Running service(kHordd, {"--config", folder / "c.toml"});
        ASSERT_TRUE(holds(service.pid(), signal)) << service.so_far().err;
        std::this_thread::sleep_for(std::chrono::microseconds(draw() % 60'000));
        const Said said = service.stop(signal);
        EXPECT_EQ(said.status, 0) << "signal " << signal << " of start " << k << "\n" << said.err;
        EXPECT_THAT(said.err, HasSubstr("hordd: stopped as asked"));
    }
}

TEST(Run, is_stopped_by_a_signal_while_it_renders_and_says_so) {
    for (const int signal : {SIGTERM, SIGINT, SIGHUP}) {
        Running line("hordctl", {"run", "--simulate", "--parts", "5", "--seed", "41", "--modbus", "127.0.0.1:0"});
        ASSERT_TRUE(blocks(line.pid(), signal)) << line.so_far().err;
        const Said said = line.stop(signal);
        EXPECT_EQ(said.status, 0) << said.err;
        EXPECT_THAT(said.err, HasSubstr("hordctl: stopped as asked, before the line ran: no part came\n"));
    }
}

TEST_F(Service, is_stopped_by_a_signal_while_it_renders_and_says_so) {
    write_config("[station]\nautostart = false\n");
    Running service("/usr/bin/env", under({"CACHE_DIRECTORY=" + (folder / "empty")}));
    ASSERT_TRUE(blocks(service.pid(), SIGTERM)) << service.so_far().err;
    const Said said = service.stop(SIGTERM);
    EXPECT_EQ(said.status, 0) << said.err;
    EXPECT_THAT(said.err, HasSubstr("stopped as asked, before the line ran\n"));
}

// A station that plays frames of `size` x `size` pixels.
class Frames : public ::testing::Test {
  protected:
    void write(int size, int count, const std::string& more = "") {
        std::filesystem::create_directories(folder / "frames");
        Frame frame(size, size, 8);
        std::uint32_t noise = 1;
        for (int y = 0; y < size; ++y) {
            for (int x = 0; x < size; ++x) frame.set(x, y, (noise = noise * 1664525U + 1013904223U) >> 24U);
        }
        const std::filesystem::path first = folder / "frames/0.png";
        EXPECT_TRUE(drivers::write_frame(first, frame.view(), std::nullopt));
        for (int k = 1; k < count; ++k)
            std::filesystem::create_hard_link(first, folder / ("frames/" + std::to_string(k) + ".png"));
        std::ofstream(folder / "c.toml") << simulated_beside(
            "[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n[modbus]\nport = 0\n" + more + kRoomyLine);
    }
    TemporaryFolder folder;
};

TEST_F(Frames, that_still_load_are_no_reason_to_wait_for_the_end) {
    write(999, 300);  // some seconds
    for (const int signal : {SIGTERM, SIGINT, SIGHUP}) {
        Running line("hordctl", {"run", "--config", folder / "c.toml"});
        ASSERT_TRUE(blocks(line.pid(), signal)) << line.so_far().err;
        const Said said = line.stop(signal);
        EXPECT_EQ(said.status, 0) << said.err;
        EXPECT_THAT(said.err, HasSubstr("hordctl: stopped as asked, before the line ran: no part came\n"));
    }
    Running service(kHordd, {"--config", folder / "c.toml"});
    ASSERT_TRUE(blocks(service.pid(), SIGTERM)) << service.so_far().err;
    const Said said = service.stop(SIGTERM);
    EXPECT_EQ(said.status, 0) << said.err;
    EXPECT_THAT(said.err, HasSubstr("stopped as asked, before the line ran\n"));
}

// The second comes while the first end watches that no part comes, or before.
TEST_F(Frames, and_their_line_end_at_a_second_signal_as_at_the_first) {
    write(27, 1, "[station]\nautostart = false\n");
    const std::filesystem::path proof = folder / "state/line-empty";
    const std::vector<std::string> arguments{"run", "--config", folder / "c.toml", "--state", folder / "state"};
    for (const int second : {SIGTERM, SIGINT, SIGHUP}) {
        Running line("hordctl", arguments);
        ASSERT_TRUE(line.says("Preoperational to Initialized")) << line.so_far().err;
        std::this_thread::sleep_for(std::chrono::milliseconds(100));
        EXPECT_FALSE(std::filesystem::exists(proof)) << "withdrawn before the line may run";
        line.signal(SIGINT);
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
        EXPECT_FALSE(std::filesystem::exists(proof)) << "nobody has watched the line for 200 ms";
        line.signal(second);
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
        EXPECT_FALSE(std::filesystem::exists(proof)) << "nobody has watched the line for 200 ms";
        const Said said = line.stop(second);
        EXPECT_EQ(said.status, 0) << said.out << said.err;
        EXPECT_TRUE(std::filesystem::exists(proof));
    }
    Running early("hordctl", arguments);
    ASSERT_TRUE(blocks(early.pid(), SIGTERM)) << early.so_far().err;
    early.signal(SIGINT);
    const Said said = early.stop(SIGTERM);
    EXPECT_EQ(said.status, 0) << "its devices were not there yet\n" << said.out << said.err;
}

TEST_F(Frames, go_on_behind_nohup_when_the_terminal_is_closed) {
    write(27, 1, "[station]\nautostart = false\n");
    Running line("/usr/bin/env",
                 {"--ignore-signal=HUP", std::string(HORD_BIN_DIR) + "/hordctl", "run", "--config", folder / "c.toml"});
    ASSERT_TRUE(line.says("Preoperational to Initialized")) << line.so_far().err;
    line.signal(SIGHUP);
    EXPECT_FALSE(line.says("no part came", std::chrono::seconds(1))) << "the report of the end";
    EXPECT_EQ(line.stop(SIGTERM).status, 0);
}

// A part is rejected 1.5 s after it came: some are on the line at any time.
TEST_F(Frames, and_their_line_end_with_one_result_for_every_part_that_came) {
    write(27, 60, "[station]\nmax_failures_in_a_row = 0\n[store]\nfree_mb = 1\nfolder = \"store\"\n");
    const std::vector<std::string> lines{"run", "--config", folder / "c.toml", "--rate", "2", "--json"};
    Running line("hordctl", lines);
    ASSERT_TRUE(line.says("{\"part\":1,")) << line.so_far().err;
    const Said said = line.stop(SIGTERM);
    EXPECT_EQ(said.status, 0) << said.err;
    EXPECT_THAT(said.err, HasSubstr("were on the line when the station ended\n"));
    const auto parts_of = [](const std::string& text, const std::regex& part) {
        std::vector<int> parts;
        for (auto it = std::sregex_iterator(text.begin(), text.end(), part); it != std::sregex_iterator(); ++it)
            parts.push_back(std::stoi((*it)[1]));
        return parts;
    };
    const std::vector<int> printed = parts_of(said.out, std::regex("\"part\":([0-9]+),"));
    EXPECT_GT(printed.size(), 2U) << said.out;
    for (std::size_t k = 0; k < printed.size(); ++k) EXPECT_EQ(printed[k], static_cast<int>(k) + 1);
    const Said stored = run("hordctl", {"results", "--store", folder / "store", "--format", "json"});
    EXPECT_EQ(parts_of(stored.out, std::regex("\"part\":([0-9]+),")), printed) << stored.out << stored.err;
}

TEST_F(Frames, leave_a_fault_that_is_not_over_if_they_end_with_parts_on_the_line) {
    write(27, 60, "[station]\nmax_failures_in_a_row = 0\n");
    Running service(kHordd, {"--config", folder / "c.toml"});
    ASSERT_TRUE(service.says("Ready to ContinuousExecution")) << service.so_far().err;
    std::this_thread::sleep_for(std::chrono::seconds(2));
    const Said said = service.stop(SIGTERM);
    EXPECT_EQ(said.status, 0) << said.err;
    EXPECT_THAT(said.err, HasSubstr("hordd: fault reject-unconfirmed: "));
    EXPECT_THAT(said.err, Not(HasSubstr("is over")));
    EXPECT_THAT(said.err, HasSubstr("ContinuousExecution to Halted\nhordd: stopped as asked\n"));
}

TEST_F(Frames, end_the_run_after_so_many_parts_or_with_the_last_one_which_is_said) {
    write(27, 4, "[station]\nmax_failures_in_a_row = 0\n");
    const std::vector<std::string> all{"run", "--config", folder / "c.toml", "--rate", "2"};
    const std::string last = "the last recorded frame was played: no part comes any more";
    const auto with_parts = [&](const std::string& count) {
        std::vector<std::string> arguments = all;
        arguments.insert(arguments.end(), {"--parts", count});
        return run("hordctl", arguments);
    };
    const Said some = with_parts("2"), more = with_parts("5"), whole = run("hordctl", all);
    EXPECT_THAT(some.out, HasSubstr("seen 2 "));
    EXPECT_THAT(some.err, Not(HasSubstr("the last recorded frame was played")));
    EXPECT_THAT(more.err, HasSubstr("the last recorded frame was played: 4 of 5 parts came\n"));
    EXPECT_THAT(whole.out, HasSubstr("seen 4 "));
    EXPECT_THAT(whole.err, HasSubstr(last));
}

}  // namespace
}  // namespace hord::test
