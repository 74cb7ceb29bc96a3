// The station on a GenICam camera: Aravis's fake GigE camera, fed with rendered frames, in a network of its own.
#include <algorithm>
#include <csignal>
#include <fstream>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/drivers/genicam/fake_gige.h"

namespace hord::test {
namespace {

using Json = nlohmann::json;

std::vector<Json> lines_of(const std::string& text) {
    std::vector<Json> out;
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);) {
        if (line.starts_with('{')) out.push_back(Json::parse(line));
    }
    return out;
}

// A line on the camera S1 alone. The frame begins when the command has reached it: late, on a busy machine.
void write_line(const std::string& file) {
    std::string line = kRoomyLine;
    line.replace(line.find("[timing]\n"), 9, "[timing]\nframe_window_us = 200000\n");
    std::ofstream(file) << simulated_beside(
        "[sensor]\nbackend = \"genicam\"\ncamera = \"S1\"\ntrigger = \"software\"\n"
        "width_px = 333\nheight_px = 333\n[modbus]\nport = 0\n" +
        line);
}

TEST(Genicam, the_line_runs_on_a_camera_and_gives_the_verdicts_that_inspect_gives) {
    const std::string refused = own_network();
    if (!refused.empty()) GTEST_SKIP() << refused;
    const TemporaryFolder folder;
    std::vector<std::string> camera{"127.0.0.1", "S1"}, inspect{"inspect", "--macro", "9x9", "--json"};
    for (const std::string scene : {"good", "bubble", "empty", "speck"}) {
        const std::string file = folder / (scene + ".png");
        const std::string path = std::string(HORD_SOURCE_DIR) + "/tests/system/rig/scenes/" + scene + ".toml";
        ASSERT_EQ(run("hord-lab", {"render", path, "--out", file}).status, 0);
        camera.push_back(file);
        inspect.push_back(file);
    }
    const auto inspected = lines_of(run("hordctl", inspect).out);
    ASSERT_EQ(inspected.size(), 4U);
    EXPECT_EQ(inspected[0]["verdict"], "pass");
    EXPECT_EQ(inspected[1]["verdict"], "reject");

    const FakeGige fake(camera);
    write_line(folder / "c.toml");
    const Said said = run("hordctl", {"run", "--config", folder / "c.toml", "--rate", "2", "--parts", "6", "--json"});
    const auto parts = lines_of(said.out);
    ASSERT_EQ(parts.size(), 6U) << said.err;
    for (std::size_t k = 0; k < parts.size(); ++k) {
        const Json& expected = inspected[k % inspected.size()];
        EXPECT_EQ(parts[k]["verdict"], expected["verdict"]) << parts[k] << said.err;
        EXPECT_EQ(parts[k]["reason"], expected["reason"]);
        EXPECT_EQ(parts[k]["ejected"], expected["verdict"] != "pass");
    }
    EXPECT_THAT(said.err, testing::HasSubstr("S1: 333 x 333 Mono8"));
}

// A scenario in real time: each tenth packet is lost and sent again, one packet of each third frame never comes.
TEST(Genicam, the_line_rejects_the_parts_whose_frames_a_network_damages_and_judges_the_others) {
    const std::string refused = own_network();
    if (!refused.empty()) GTEST_SKIP() << refused;
    const TemporaryFolder folder;
    std::vector<std::string> camera{"127.0.0.1", "S1", "resend=10", "never=25"};
    for (const std::string scene : {"good", "bubble"}) {
        camera.push_back(folder / (scene + ".png"));
        const std::string path = std::string(HORD_SOURCE_DIR) + "/tests/system/rig/scenes/" + scene + ".toml";
        ASSERT_EQ(run("hord-lab", {"render", path, "--out", camera.back()}).status, 0);
    }
    const FakeGige fake(camera);
    write_line(folder / "c.toml");
    const Said said = run("hordctl", {"run", "--config", folder / "c.toml", "--rate", "2", "--parts", "6", "--json"});
    const auto parts = lines_of(said.out);
    ASSERT_EQ(parts.size(), 6U) << said.err;
    int damaged = 0;
    for (std::size_t k = 0; k < parts.size(); ++k) {
        const bool unfit = parts[k]["verdict"] == "unfit";
        damaged += unfit ? 1 : 0;
        EXPECT_EQ(parts[k]["verdict"], unfit ? "unfit" : k % 2 == 0 ? "pass" : "reject") << parts[k] << said.err;
        EXPECT_EQ(parts[k]["reason"] == "frame-corrupt", unfit) << parts[k];
        EXPECT_EQ(parts[k]["ejected"], parts[k]["verdict"] != "pass");
    }
    // More on a busy machine; all of them if no packet came again.
    EXPECT_THAT(damaged, testing::AllOf(testing::Ge(2), testing::Le(4))) << said.err;
    EXPECT_THAT(said.err,
                testing::ContainsRegex("a frame is damaged: packets of it did not come, although lost ones .*"
                                       "[2-4] frames complete, [2-4] incomplete"));
}

TEST(Genicam, the_line_runs_with_the_light_on_the_cameras_own_output) {
    const std::string refused = own_network();
    if (!refused.empty()) GTEST_SKIP() << refused;
    const TemporaryFolder folder;
    const std::string file = folder / "good.png";
    ASSERT_EQ(
        run("hord-lab", {"render", std::string(HORD_SOURCE_DIR) + "/tests/system/rig/scenes/good.toml", "--out", file})
            .status,
        0);
    const FakeGige fake({"127.0.0.1", "S1", "lines", file});
    std::string line = kRoomyLine;
    line.replace(line.find("[timing]\n"), 9,
                 "[timing]\nframe_window_us = 200000\nstrobe_window_us = 200000\nstrobe_delay_us = 0\n"
                 "strobe_us = 100000\nexposure_us = 100000\n");
    std::ofstream(folder / "c.toml") << simulated_beside(
        "[sensor]\nbackend = \"genicam\"\ntrigger = \"software\"\nwidth_px = 333\nheight_px = 333\n"
        "[strobe]\nbackend = \"camera\"\ncamera_line = \"Line2\"\nmax_on_us = 100000\nmax_duty = 0.5\n"
        "[modbus]\nport = 0\n" +
        line);
    const Said said = run("hordctl", {"run", "--config", folder / "c.toml", "--rate", "2", "--parts", "4", "--json"});
    const auto parts = lines_of(said.out);
    ASSERT_EQ(parts.size(), 4U) << said.err;
    for (const Json& part : parts) EXPECT_EQ(part["verdict"], "pass") << part << said.err;
    // There is no frame without light, and no light without a frame.
    const Said selftest = run("hordctl", {"selftest", "--config", folder / "c.toml"});
    EXPECT_EQ(selftest.status, 0) << selftest.out << selftest.err;
    EXPECT_THAT(selftest.out,
                testing::AllOf(testing::HasSubstr("the camera's Line2, 1 collimator"),
                               testing::HasSubstr("the camera lights every exposure"),
                               testing::ContainsRegex("exposure +good")));
}

// No GPIO line at all: barrier, light and frames are the camera's.
TEST(Genicam, the_line_runs_with_barrier_and_light_on_the_camera) {
    const std::string refused = own_network();
    if (!refused.empty()) GTEST_SKIP() << refused;
    const TemporaryFolder folder;
    std::vector<std::string> camera{"127.0.0.1", "S1", "lines", "events"};
    for (const std::string scene : {"good", "bubble"}) {
        const std::string file = folder / (scene + ".png");
        const std::string path = std::string(HORD_SOURCE_DIR) + "/tests/system/rig/scenes/" + scene + ".toml";
        ASSERT_EQ(run("hord-lab", {"render", path, "--out", file}).status, 0);
        camera.push_back(file);
    }
    FakeGige fake(camera);
    std::string line = kRoomyLine;
    line.replace(line.find("[timing]\n"), 9,
                 "[timing]\nframe_window_us = 200000\nstrobe_window_us = 200000\nstrobe_delay_us = 0\n"
                 "strobe_us = 100000\nexposure_us = 100000\n");
    std::ofstream(folder / "c.toml") << simulated_beside(
        "[sensor]\nbackend = \"genicam\"\ntrigger = \"software\"\nwidth_px = 333\nheight_px = 333\n"
        "[strobe]\nbackend = \"camera\"\ncamera_line = \"Line2\"\nmax_on_us = 100000\nmax_duty = 0.5\n"
        "[part_sensor]\nbackend = \"camera\"\ncamera_line = \"Line1\"\n[modbus]\nport = 0\n" +
        line);
    const std::string store = folder / "store";
    Running station("hordctl", {"run", "--config", folder / "c.toml", "--store", store, "--json"});
    ASSERT_TRUE(station.says("Preoperational to Error")) << station.so_far().err;  // nobody knows what is on the line
    const std::string told = station.so_far().err, before = "registers at ";
    const std::size_t at = told.find(before) + before.size();
    const std::string registers = told.substr(at, told.find('\n', at) - at);
    Said reset;
    for (int k = 0; k < 100 && reset.status != 0; ++k)  // a reset soon after the stop is refused
        reset = run("hordctl", {"command", "reset", "--modbus", registers});
    ASSERT_EQ(reset.status, 0) << reset.err;
    ASSERT_TRUE(station.says("to ContinuousExecution")) << station.so_far().err;
    const auto results = [&] {
        return lines_of(run("hordctl", {"results", "--store", store, "--format", "json"}).out);
    };
    std::vector<Json> parts;
    for (std::size_t part = 1; part <= 4; ++part) {
        fake.set_input(true);
        std::this_thread::sleep_for(std::chrono::milliseconds(100));
        fake.set_input(false);
        for (int k = 0; k < 100 && parts.size() < part; ++k) parts = results();
        ASSERT_EQ(parts.size(), part) << station.so_far().err;
    }
    const Said said = station.stop(SIGINT);
    std::ranges::sort(parts, {}, [](const Json& one) { return one.at("part").get<int>(); });
    for (std::size_t k = 0; k < parts.size(); ++k)
        EXPECT_EQ(parts[k]["verdict"], k % 2 == 0 ? "pass" : "reject") << parts[k] << said.err;
    // A line that is not simulated has no truth, but every part is told and counted.
    const std::vector<Json> told_parts = lines_of(said.out);
    ASSERT_EQ(told_parts.size(), 4U) << said.out << said.err;
    for (const Json& one : told_parts) {
        EXPECT_FALSE(one.contains("truth")) << one;
        EXPECT_EQ(one["ejected"], one["verdict"] == "reject") << one;
    }
    EXPECT_THAT(said.err, testing::HasSubstr("(4 parts)"));
    // The barrier is heard while the camera streams.
    const Said selftest = run("hordctl", {"selftest", "--config", folder / "c.toml"});
    EXPECT_EQ(selftest.status, 0) << selftest.out << selftest.err;
    EXPECT_THAT(selftest.out, testing::HasSubstr("the camera's Line1, 0 edges"));
}

TEST(Genicam, devices_lists_a_free_camera_and_names_who_holds_one_that_is_used) {
    const std::string refused = own_network();
    if (!refused.empty()) GTEST_SKIP() << refused;
    const TemporaryFolder folder;
    const auto camera = [] {
        const Said said = run("hordctl", {"devices", "--json"});
        EXPECT_EQ(said.status, 0) << said.err;
        const Json cameras = Json::parse(said.out)["genicam"]["devices"];
        EXPECT_EQ(cameras.size(), 1U) << said.out;
        return cameras.empty() ? Json::object() : cameras[0];
    };
    EXPECT_THAT(run("hordctl", {"devices"}).out, testing::HasSubstr("no GenICam camera found"));

    const FakeGige fake;
    const Json free = camera();
    EXPECT_EQ(free["name"], "S1");
    EXPECT_FALSE(free.contains("in_use_by")) << free;
    const auto mono = std::ranges::find_if(free["formats"], [](const Json& one) { return one["name"] == "Mono8"; });
    ASSERT_NE(mono, free["formats"].end()) << free;
    EXPECT_EQ((*mono)["bits"], 8);
    EXPECT_FALSE(free["formats"][0]["usable"]) << "Bayer";
    EXPECT_THAT(free["triggers"].dump(), testing::HasSubstr("Software"));
    const std::string suggested = free["config"];
    EXPECT_THAT(suggested, testing::HasSubstr("camera = \"S1\""));
    std::ofstream(folder / "suggested.toml") << simulated_beside(suggested);
    EXPECT_EQ(run("hordd", {"--check", "--config", folder / "suggested.toml"}).status, 0);

    std::ofstream(folder / "c.toml") << simulated_beside(
        "[sensor]\nbackend = \"genicam\"\ncamera = \"S1\"\ntrigger = \"software\"\nwidth_px = 504\nheight_px = "
        "504\n[modbus]\nport = 0\n");
    Running station("hordctl", {"run", "--config", folder / "c.toml", "--json"});
    ASSERT_TRUE(station.says("S1: ")) << station.so_far().err;  // it streams
    const Json held = camera();
    EXPECT_THAT(held["in_use_by"].dump(), testing::HasSubstr("hord-genicam (process ")) << held;
    EXPECT_FALSE(held.contains("formats")) << "it was taken";
    EXPECT_THAT(station.so_far().err, testing::Not(testing::HasSubstr("is lost")));
}

}  // namespace
}  // namespace hord::test
