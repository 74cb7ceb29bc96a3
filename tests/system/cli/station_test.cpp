// `hordctl run`, `status` and `registers`: the whole station as a person and a PLC meet it.
#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "firmware/registers/register_client.h"
#include "tests/support/modbus_module/modbus_module.h"
#include "tests/system/cli/program.h"
#include "tests/system/cli/station_fixture.h"

namespace hord::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

class MonotonicClock : public hal::Clock {
  public:
    [[nodiscard]] hal::TimePoint now() const override {
        return hal::TimePoint(std::chrono::steady_clock::now().time_since_epoch());
    }
};

// -- registers

TEST(Registers, are_printed_in_every_format) {
    EXPECT_THAT(run("hordctl", {"registers"}).out, HasSubstr("| "));
    EXPECT_THAT(run("hordctl", {"registers", "--format", "csv"}).out, HasSubstr("heartbeat"));
    EXPECT_FALSE(Json::parse(run("hordctl", {"registers", "--format", "json"}).out).empty());
    EXPECT_THAT(run("hordctl", {"registers", "--format", "telegraf"}).out, HasSubstr("[[inputs.modbus]]"));
    EXPECT_THAT(run("hordctl", {"registers", "--format", "st"}).out, HasSubstr("VAR_GLOBAL CONSTANT"));
}

TEST(Registers, refuse_an_unknown_format) {
    const Said said = run("hordctl", {"registers", "--format", "xml"});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("xml"));
}

// -- status

TEST(Status, says_so_when_nobody_answers) {
    const HeldPort refusing(false), silent(true);
    for (const std::string& address : {refusing.address(), silent.address()}) {
        const Said said = run("hordctl", {"status", "--modbus", address, "--timeout", "300"}, std::chrono::seconds(20));
        EXPECT_EQ(said.status, 2);
        EXPECT_THAT(said.err, HasSubstr(address.substr(address.find(':') + 1)));
    }
}

// -- run

TEST(Run, that_comes_into_error_says_which_fault_and_its_cure_and_status_names_both) {
    const TemporaryFolder folder;
    const HeldPort refusing(false);
    std::ofstream(folder / "c.toml") << simulated_beside(
        "[rejector]\nbackend = \"modbus\"\nport = " + std::to_string(refusing.port()) + "\n[modbus]\nport = 0\n");
    Running station("hordctl", {"run", "--config", folder / "c.toml", "--variety", "1"});
    ASSERT_TRUE(station.says("to Error", kRendering)) << station.so_far().err;
    ASSERT_TRUE(
        station.says("FAULT rejector: the rejector's module does not answer, refuses, or does not hold its "
                     "outputs as written: see the message before it; check its supply"));
    const std::string err = station.so_far().err;
    const auto at = err.find("registers at ") + 13;
    const std::string address = err.substr(at, err.find('\n', at) - at);
    const Json status = Json::parse(run("hordctl", {"status", "--modbus", address, "--json"}).out);
    EXPECT_EQ(status["STATUS"]["state_text"], "Error") << status;
    EXPECT_TRUE(status["STATUS"]["state"].is_number_integer()) << status["STATUS"]["state"];
    EXPECT_TRUE(status["COUNTERS"]["seen"].is_number_integer());
    ASSERT_FALSE(status["faults"].empty()) << status;
    EXPECT_EQ(status["faults"][0]["name"], "rejector");
    EXPECT_EQ(status["faults"][0]["active"], true);
    EXPECT_THAT(status["faults"][0]["cure"].get<std::string>(), HasSubstr("check its supply"));
    EXPECT_THAT(run("hordctl", {"recipe", "use", "7", "--modbus", address}).err,
                AllOf(HasSubstr("refused: no_such_recipe, the folder of recipes "),
                      HasSubstr(": make it, or name another one in inspection.recipes\n")))
        << "the reply has the station's own cure whole; the reason before it may be cut";

    // On a terminal of 60 columns no line of the page is longer.
    const Said page = run("/usr/bin/script",
                          {"-qefc",
                           "stty cols 60 rows 60; \"" + std::string(HORD_BIN_DIR) +
                               "\"/hordctl watch --count 1 --timeout 10000 --modbus " + address,
                           "/dev/null"});
    EXPECT_THAT(page.out, HasSubstr("FAULT rejector"));
    std::istringstream lines(page.out);
    for (std::string line; std::getline(lines, line);) {
        while (line.ends_with('\r')) line.pop_back();
        if (line.starts_with("\x1b[H\x1b[2J")) line.erase(0, 7);
        EXPECT_LE(std::ranges::count_if(line, [](char c) { return (c & 0xC0) != 0x80; }), 60) << line;
    }
    const std::string waits = "done; the line starts when every device is up: see hordctl status\n";
    std::string reset;  // refused soon after a stop; a part that comes stops the line again
    for (int k = 0; k < 100 && reset != waits; ++k)
        reset = run("hordctl", {"command", "reset", "--modbus", address}).out;
    EXPECT_EQ(reset, waits);
}

// Nobody would answer while the cell renders.
TEST(Run, opens_its_register_port_when_it_can_answer) {
    int port = 0;
    {
        const HeldPort free(false);
        port = free.port();
    }
    const std::string address = "127.0.0.1:" + std::to_string(port);
    Running station("hordctl", {"run", "--simulate", "--variety", "1", "--modbus", address});
    ASSERT_TRUE(station.says("render parts")) << station.so_far().err;
    const Said early = run("hordctl", {"status", "--modbus", address, "--timeout", "300"});
    if (station.so_far().err.find("registers at") == std::string::npos) {
        EXPECT_THAT(early.err, HasSubstr("refused")) << "it listened, and did not answer";
    }
    ASSERT_TRUE(station.says("registers at", kRendering)) << station.so_far().err;
    EXPECT_EQ(run("hordctl", {"status", "--modbus", address, "--timeout", "20000"}).status, 0);
}

TEST(Run, simulated_parts_get_one_verdict_each_and_bad_ones_leave_through_the_ejector) {
    const Said said = run(
        "hordctl",
        {"run", "--simulate", "--variety", "1", "--parts", "12", "--rate", "2", "--modbus", "127.0.0.1:0", "--json"},
        std::chrono::seconds(120));
    ASSERT_EQ(said.status, 0) << said.err;
    const auto parts = json_lines(said.out);
    ASSERT_EQ(parts.size(), 12U) << said.out;
    std::set<int>
        numbers;  // a part is printed when its fate is known: ejected parts before those that leave at the end
    for (std::size_t k = 0; k < parts.size(); ++k) {
        EXPECT_TRUE(numbers.insert(parts[k]["part"].get<int>()).second) << parts[k];
        EXPECT_EQ(parts[k]["ejected"], parts[k]["verdict"] != "pass") << parts[k];
        EXPECT_EQ(parts[k]["truth"] == "good", parts[k]["verdict"] == "pass") << parts[k];
    }
}

// Light that is missing, neighbours that disagree, a deflection that changes too fast: each kind of defect has its own.
TEST(Run, simulated_defects_are_rejected_for_three_reasons_and_shown_beside_an_ordinary_camera_s_picture) {
    const TemporaryFolder folder;
    const Said said = run("hordctl",
                          {"run", "--simulate", "--variety", "1", "--parts", "12", "--good", "0.1", "--rate", "2",
                           "--modbus", "127.0.0.1:0", "--json", "--out", folder / "pictures"},
                          std::chrono::seconds(120));
    ASSERT_EQ(said.status, 0) << said.err;
    std::set<std::string> reasons;
    for (const Json& part : json_lines(said.out)) {
        const std::string truth = part["truth"], reason = part["reason"];
        if (truth == "good") continue;
        reasons.insert(reason);
        const bool deflects = truth == "dimple" || truth == "stria" || truth == "inclusion" || truth == "haze";
        if (deflects || truth == "speck") {
            EXPECT_EQ(reason == "absorption", !deflects) << part;
        }
    }
    EXPECT_THAT(reasons, ::testing::IsSupersetOf({"neighbours-disagree", "deflection-gradient", "absorption"}));
    EXPECT_TRUE(std::filesystem::exists(folder / "pictures/montage.png"));
}

// Its rejector's module has no watchdog: only the station drops the run permit.
TEST(Run, halts_however_it_is_ended_and_goes_on_when_nobody_hears_its_messages) {
    const TemporaryFolder folder;
    const MonotonicClock clock;
    const auto module = std::move(*ModbusModule::open(clock));
    std::string line = std::string(kRoomyLine) + "[modbus]\nport = 0\n";
    const std::string rejector = "[rejector]\n";
    line.insert(line.find(rejector) + rejector.size(),
                "backend = \"modbus\"\nport = " + std::to_string(module->port()) + "\n");
    std::ofstream(folder / "c.toml") << simulated_beside(line);
    const std::string hordctl = std::string(HORD_BIN_DIR) + "/hordctl";
    const auto permit_comes_to_be = [&](bool on) {
        for (int k = 0; k < 24'000 && module->coil(1) != on; ++k)
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        return module->coil(1) == on;
    };
    for (const auto& [messages, ends] : {std::pair("", SIGHUP),
                                         {"", SIGQUIT},
                                         {"2>/dev/full", SIGTERM},
                                         {"2>&-", SIGINT},
                                         {"2> >(head -n 1 >/dev/null)", SIGTERM}}) {
        SCOPED_TRACE(std::string(messages) + ", signal " + std::to_string(ends));
        Running station(
            "/bin/bash",
            {"-c", "exec " + hordctl + " run --config " + (folder / "c.toml") + " --variety 1 --rate 2 " + messages});
        ASSERT_TRUE(permit_comes_to_be(true)) << station.so_far().err;
        for (const int mistaken : {SIGUSR1, SIGUSR2, SIGALRM}) station.signal(mistaken);
        EXPECT_EQ(station.stop(ends).status, 0) << station.so_far().err;
        EXPECT_FALSE(module->coil(1));
    }
}

TEST(Run, vitals_are_written_and_stay_flat) {
    const TemporaryFolder folder;
    const Said said = run("hordctl",
                          {"run", "--simulate", "--variety", "1", "--parts", "60", "--modbus", "127.0.0.1:0",
                           "--vitals", folder / "v.csv", "--vitals-every", "1"},
                          std::chrono::seconds(120));
    EXPECT_THAT(said.out, HasSubstr("descriptors"));
    std::ifstream file(folder / "v.csv");
    std::string line;
    ASSERT_TRUE(std::getline(file, line));
    EXPECT_EQ(line, "until_s,parts,late,unfit,p50_ms,p99_ms,max_ms,memory_kb,descriptors,threads,processor");
    std::vector<std::vector<double>> rows;
    while (std::getline(file, line)) {
        std::istringstream cells(line);
        auto& row = rows.emplace_back();
        for (std::string cell; std::getline(cells, cell, ',');) row.push_back(std::stod(cell));
        ASSERT_EQ(row.size(), 11U) << line;
    }
    ASSERT_GE(rows.size(), 3U) << said.err;  // six seconds of parts, even on a slow machine
    double parts = 0;
    for (const auto& row : rows) parts += row[1];
    EXPECT_LE(parts, 60);
    EXPECT_EQ(rows.back()[8], rows[1][8]) << "descriptors";
    EXPECT_LT(rows.back()[7], rows[1][7] + 8'000) << "kB of memory";
}

TEST(Run, resets_no_real_line_by_itself) {
    const Said said = run("hordctl", {"run", "--reset-after", "1"});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("--simulate"));
}

// A process that was suspended for longer than a part's way to the ejector stops its line. After a reset the parts
// continue.
TEST(Run, is_reset_after_it_was_held_up_and_goes_on) {
    Running station("hordctl",
                    {"run", "--simulate", "--variety", "1", "--rate", "2", "--modbus", "127.0.0.1:0", "--reset-after",
                     "1", "--json"});
    ASSERT_TRUE(station.says("\"part\":3", std::chrono::seconds(120))) << station.so_far().err;
    station.signal(SIGSTOP);
    std::this_thread::sleep_for(std::chrono::seconds(2));
    station.signal(SIGCONT);
    ASSERT_TRUE(station.says("Error to Initialized", std::chrono::seconds(120))) << station.so_far().err;
    const std::string& out = station.so_far().out;
    const int last = std::stoi(out.substr(out.rfind("\"part\":") + 7));
    EXPECT_TRUE(station.says("\"part\":" + std::to_string(last + 8) + ",", std::chrono::seconds(120)))
        << station.so_far().err;
    const Said said = station.stop(SIGINT);
    EXPECT_THAT(said.err, HasSubstr("the line was stopped and reset"));
}

// With mbpoll, an independent Modbus client, and with hordctl's own client.
TEST(Run, ident_to_last_can_be_read_while_it_runs) {
    Running station("hordctl",
                    {"run", "--simulate", "--variety", "1", "--rate", "2", "--modbus", "127.0.0.1:0", "--json"});
    ASSERT_TRUE(station.says("\"part\":3", std::chrono::seconds(120))) << station.so_far().err;
    const std::string port = port_of(station.so_far());
    ASSERT_NE(port, "");
    const auto poll = [&](int from, int count) {
        return run("/usr/bin/mbpoll",
                   {"-m", "tcp", "-p", port, "-0", "-o", "10", "-r", std::to_string(from), "-c", std::to_string(count),
                    "-t", "4:hex", "-1", "127.0.0.1"});
    };
    const Said ident = poll(0, 10);
    EXPECT_EQ(ident.status, 0) << ident.out << ident.err;
    EXPECT_THAT(ident.out, HasSubstr("0x484F"));  // "HO", of "HORD"
    EXPECT_THAT(ident.out, HasSubstr("0x5244"));  // "RD"
    EXPECT_EQ(poll(100, 20).status, 0);           // STATUS
    EXPECT_EQ(poll(140, 20).status, 0);           // COUNTERS
    EXPECT_EQ(poll(200, 20).status, 0);           // LAST

    const Said said = run("hordctl", {"status", "--modbus", "127.0.0.1:" + port, "--json"});
    ASSERT_EQ(said.status, 0) << said.err;
    const Json status = Json::parse(said.out);
    EXPECT_EQ(status["STATUS"]["state"], 8);  // ContinuousExecution
    EXPECT_GE(status["COUNTERS"]["seen"], 3);
    const auto counted = [&](const char* name) { return status["COUNTERS"][name].get<int>(); };
    EXPECT_GE(counted("inspected"), 3);
    EXPECT_EQ(counted("missed"), 0);
    EXPECT_LE(counted("pass") + counted("reject") + counted("unfit"), counted("seen"));
    EXPECT_EQ(station.stop(SIGINT).status, 0);
}

// With no time for an exact distance, the third part's score is a bound.
TEST(Run, a_score_that_is_a_bound_is_told_as_one_by_line_registers_and_store) {
    const TemporaryFolder folder;
    std::string line = kRoomyLine;
    line.replace(line.find("[timing]\n"), 9, "[timing]\ninspect_budget_ms = 0.001\n");
    std::ofstream(folder / "c.toml") << line;
    Running station("hordctl",
                    {"run", "--simulate", "--config", folder / "c.toml", "--rate", "2", "--variety", "1", "--modbus",
                     "127.0.0.1:0", "--json", "--store", folder / "store"});
    ASSERT_TRUE(station.says("\"part\":3", std::chrono::seconds(120))) << station.so_far().err;
    const auto port = static_cast<std::uint16_t>(std::stoi(port_of(station.so_far())));
    auto client = firmware::modbus::Client::connect({"127.0.0.1", port}, std::chrono::seconds(10));
    ASSERT_TRUE(client) << client.error().message();
    std::map<std::string, bool> by_registers;
    for (std::uint32_t part = 1; part <= 3; ++part) {
        const auto readings = client->read_result(part);
        ASSERT_TRUE(readings) << readings.error().message();
        std::string number, flags;
        for (const auto& reading : *readings) {
            if (reading.what->name == std::string("part")) number = reading.text;
            if (reading.what->name == std::string("flags")) flags = reading.text;
        }
        by_registers[number] = flags.find("bounded") != std::string::npos;
    }
    const auto told = json_lines(station.stop(SIGTERM).out);
    const auto stored = json_lines(run("hordctl", {"results", "--store", folder / "store", "--format", "json"}).out);
    std::map<std::string, bool> by_line, by_store;
    for (const Json& part : told) by_line[to_string(part["part"])] = part.value("bounded", false);
    for (const Json& part : stored) by_store[to_string(part["part"])] = part["bounded"];
    EXPECT_FALSE(by_line["1"]);
    EXPECT_TRUE(by_line["3"]);
    for (const auto& [part, bounded] : by_registers) {
        EXPECT_EQ(bounded, by_line[part]) << part;
        EXPECT_EQ(bounded, by_store[part]) << part;
    }
}

}  // namespace
}  // namespace hord::test
