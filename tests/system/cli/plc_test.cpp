// `hordctl run` as a PLC meets it.
#include <chrono>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/registers/register_client.h"
#include "tests/system/cli/program.h"
#include "tests/system/cli/station_fixture.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;

// Talks to a station as a PLC program does: sends commands by token and polls until a condition holds.
class Plc {
  public:
    explicit Plc(const std::string& port) : client_(connect(port)) { boot_ = read(8, 1)[0]; }
    std::vector<std::uint16_t> read(std::uint16_t address, std::size_t count) {
        auto words = client_.read(address, count);
        EXPECT_TRUE(words) << words.error().message();
        return words ? *words : std::vector<std::uint16_t>(count);
    }
    std::uint32_t read32(std::uint16_t address) {
        const auto words = read(address, 2);
        return std::uint32_t{words[0]} << 16U | words[1];
    }
    Result<void> write(std::uint16_t address, const std::vector<std::uint16_t>& words) {
        return client_.write(address, words);
    }
    // The error of the reply, when it has come.
    int command(std::uint16_t code, std::uint16_t argument = 0) {
        EXPECT_TRUE(write(8002, {0, ++token_, boot_, code, 0, argument}));
        EXPECT_TRUE(comes([&] { return read(8023, 1)[0] == token_ && read(8025, 1)[0] >= 2; }));
        return read(8026, 1)[0];
    }
    template <class F>
    bool comes(F what) {
        const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
        while (std::chrono::steady_clock::now() < end) {
            if (what()) return true;
        }
        return false;
    }
    bool state_is(int state) {
        return comes([&] { return read(102, 1)[0] == state; });
    }

  private:
    static firmware::modbus::Client connect(const std::string& port) {
        auto client = firmware::modbus::Client::connect({"127.0.0.1", static_cast<std::uint16_t>(std::stoi(port))},
                                                        std::chrono::seconds(10));
        if (!client) throw std::runtime_error(client.error().message());
        return std::move(*client);
    }
    firmware::modbus::Client client_;
    std::uint16_t boot_ = 0, token_ = 0;
};

TEST(Plc, brings_the_station_up_takes_results_changes_the_recipe_and_tests_it) {
    const TemporaryFolder folder;
    std::filesystem::create_directories(folder / "recipes");
    std::ofstream(folder / "recipes/seven.toml")
        << "schema = 1\nname = \"seven\"\nnumber = 7\n[limits]\nemd_bins = 0.9\n";
    std::ofstream(folder / "c.toml") << "[station]\nautostart = false\n[plc]\npolicy = \"stop\"\ntimeout_ms = 60000\n"
                                     << kRoomyLine;
    Running station("hordctl",
                    {"run", "--simulate", "--config", folder / "c.toml", "--rate", "2", "--variety", "1", "--modbus",
                     "127.0.0.1:0"});
    ASSERT_TRUE(station.says("registers at", std::chrono::seconds(120))) << station.so_far().err;
    Plc plc(port_of(station.so_far()));
    EXPECT_TRUE(plc.write(8102, {1}));  // alive
    ASSERT_TRUE(plc.state_is(5));
    ASSERT_TRUE(plc.comes([&] { return plc.command(2) == 0; }));  // arm, as soon as the rejector's module is found
    EXPECT_EQ(plc.command(22), 0) << "self-test found " << plc.read32(8027) << station.so_far().err;
    EXPECT_EQ(plc.command(23, 7), 0) << station.so_far().err;
    EXPECT_EQ(plc.read(110, 1)[0], 7);  // the recipe in use
    EXPECT_EQ(plc.command(5), 0);
    ASSERT_TRUE(plc.state_is(8));
    ASSERT_TRUE(plc.comes([&] { return plc.read32(106) >= 2; }));
    EXPECT_EQ(plc.read32(1024), 1U);  // the first result and its recipe
    EXPECT_EQ(plc.read(1024 + 20, 1)[0], 7);
    EXPECT_TRUE(plc.write(8103, {0, 2}));
    EXPECT_FALSE(plc.write(8103, {0, 1}));  // the acknowledged sequence must not decrease
    // Through hordctl, as a person.
    const std::string address = "127.0.0.1:" + port_of(station.so_far());
    const Said watched = run("hordctl", {"watch", "--modbus", address, "--count", "2", "--every", "20"});
    EXPECT_EQ(watched.status, 0) << watched.err;
    EXPECT_EQ(std::count(watched.out.begin(), watched.out.end(), '\n'), 2);
    EXPECT_THAT(watched.out, HasSubstr("ContinuousExecution parts/min "));
    EXPECT_THAT(watched.out, HasSubstr("faults "));  // not which ones: a busy machine misses flashes
    const Said refused = run("hordctl", {"command", "arm", "--modbus", address});
    EXPECT_EQ(refused.status, 2);
    EXPECT_THAT(refused.err, HasSubstr("not_in_this_state"));
    EXPECT_THAT(refused.err, HasSubstr("the station is ContinuousExecution: possible are stop, abort"));
    EXPECT_EQ(run("hordctl", {"command", "stop", "--modbus", address}).status, 0);
    ASSERT_TRUE(plc.state_is(6));
    Said tested;
    ASSERT_TRUE(plc.comes([&] {  // once the belt stands and the parts on it have gone
        tested = run("hordctl", {"selftest", "--modbus", address});
        return tested.err.find("not_yet") == std::string::npos;
    })) << tested.err;
    EXPECT_THAT(tested.out, HasSubstr("self-test passed")) << tested.err;
    EXPECT_EQ(plc.read32(115) & 0x10U, 0U);  // every rejection was confirmed
    EXPECT_EQ(station.stop(SIGINT).status, 0);
}

// A person at a simulated line: the belt waits for the first start, and a reset finds an empty line. Each halt comes
// while a part covers the part sensor.
TEST(Plc, halts_resets_and_brings_up_a_simulated_line_again_and_again) {
    const TemporaryFolder folder;
    std::ofstream(folder / "c.toml") << "[station]\nautostart = false\n" << kRoomyLine;
    Running station("hordctl",
                    {"run", "--simulate", "--config", folder / "c.toml", "--rate", "2", "--variety", "1", "--modbus",
                     "127.0.0.1:0"});
    ASSERT_TRUE(station.says("registers at", kRendering)) << station.so_far().err;
    Plc plc(port_of(station.so_far()));
    const auto seen = [&] { return plc.read32(142); };
    // Longer than Service::kLineWaits, and the way of a part to the part sensor.
    const auto until = std::chrono::steady_clock::now() + std::chrono::milliseconds(3500);
    while (std::chrono::steady_clock::now() < until) ASSERT_EQ(seen(), 0U) << "the belt moves without a run permit";
    for (int round = 0; round < 2; ++round) {
        ASSERT_TRUE(plc.comes([&] { return plc.command(2) == 0; })) << station.so_far().err;
        ASSERT_EQ(plc.command(5), 0) << station.so_far().err;
        const std::uint32_t before = seen();
        ASSERT_TRUE(plc.comes([&] { return seen() >= before + 2; })) << station.so_far().err;
        ASSERT_TRUE(plc.state_is(8)) << station.so_far().err;
        ASSERT_EQ(plc.command(8), 0);
        ASSERT_TRUE(plc.comes([&] { return plc.command(9) == 0; })) << station.so_far().err;  // the stop was seen
        ASSERT_EQ(plc.command(1), 0);
    }
    EXPECT_THAT(station.so_far().err, testing::Not(HasSubstr("to Error"))) << "no part was left on the belt";
}

TEST(Plc, writes_only_where_the_configuration_lets_it) {
    const TemporaryFolder folder;
    std::ofstream(folder / "c.toml") << simulated_beside("[modbus]\nport = 1\nmay_write = [\"192.0.2.0/24\"]\n");
    Running station("hordctl", {"run", "--variety", "1", "--config", folder / "c.toml", "--modbus", "127.0.0.1:0"});
    ASSERT_TRUE(station.says("registers at", std::chrono::seconds(120))) << station.so_far().err;
    Plc plc(port_of(station.so_far()));
    EXPECT_EQ(plc.read(2, 1)[0], 0x484F);
    EXPECT_FALSE(plc.write(8102, {1}));
    EXPECT_EQ(station.stop(SIGINT).status, 0);
}

}  // namespace
}  // namespace hord::test
