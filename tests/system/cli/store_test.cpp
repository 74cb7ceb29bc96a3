// The store: written by a station; listed, verified and replayed by hordctl.
#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <sstream>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

namespace fs = std::filesystem;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using Json = nlohmann::json;

std::size_t lines(const std::string& text) {
    return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

Said produce(const TemporaryFolder& folder, int parts, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments{
        "run", "--simulate", "--variety",   "1",      "--parts", std::to_string(parts), "--rate", "2", "--good",
        "0.5", "--modbus",   "127.0.0.1:0", "--json", "--store", folder / "store"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run("hordctl", arguments);
}

// As a service: the store is that of the state folder, and the line goes on without it.
Said produce_as_a_service(const TemporaryFolder& folder, int parts) {
    return run("hordctl",
               {"run", "--simulate", "--variety", "1", "--parts", std::to_string(parts), "--rate", "2", "--good", "0.5",
                "--modbus", "127.0.0.1:0", "--json", "--state", folder.path()});
}

TEST(Store, of_a_simulated_line_holds_every_part_verifies_and_replays_to_the_bit) {
    const TemporaryFolder folder;
    const std::string store = folder / "store";
    const Said produced = produce(folder, 12);
    ASSERT_EQ(produced.status, 0) << produced.err;

    const Said listed = run("hordctl", {"results", "--store", store, "--format", "json"});
    ASSERT_EQ(listed.status, 0) << listed.err;
    EXPECT_EQ(lines(listed.out), 12U);
    std::map<int, std::string> verdicts;
    std::istringstream rows(listed.out);
    for (std::string row; std::getline(rows, row);) {
        const Json json = Json::parse(row);
        verdicts[json["part"].get<int>()] = json["verdict"].get<std::string>();
    }
    std::istringstream told(produced.out);
    for (std::string row; std::getline(told, row);) {
        if (row.empty() || row[0] != '{') continue;
        const Json json = Json::parse(row);
        EXPECT_EQ(verdicts[json["part"].get<int>()], json["verdict"].get<std::string>()) << row;
    }
    EXPECT_EQ(lines(run("hordctl", {"results", "--store", store, "--last", "3", "--format", "csv"}).out), 1U + 3U);
    EXPECT_THAT(run("hordctl", {"results", "changes", "--store", store}).out, HasSubstr("start"));

    // Rows for people have an age: those of a store that nobody writes any more look like those of a station that runs.
    EXPECT_THAT(run("hordctl", {"results", "--store", store}).err,
                ContainsRegex("^hordctl: the newest result of this store is of 20[^ ]*Z, [0-9]+ (s|min) ago\n$"));
    EXPECT_EQ(listed.err, "") << "JSON and CSV have the time alone";

    const Said mistyped = run("hordctl", {"results", "--store", store, "--recipe", "defualt"});
    EXPECT_EQ(mistyped.status, 2);
    EXPECT_THAT(mistyped.err, HasSubstr("no recipe of this store is called \"defualt\": use one of default"));

    const Said verified = run("hordctl", {"results", "verify", "--store", store});
    EXPECT_EQ(verified.status, 0) << verified.out;
    EXPECT_THAT(verified.out, HasSubstr("results: 12 rows, 1 to 12"));

    const Said replayed = run("hordctl", {"replay", "--store", store, "--json"});
    EXPECT_EQ(replayed.status, 0) << replayed.out << replayed.err;
    ASSERT_GT(lines(replayed.out), 0U);
    std::istringstream each(replayed.out);
    for (std::string line; std::getline(each, line);) EXPECT_THAT(line, HasSubstr("\"explain\":\"")) << line;
    std::ofstream(folder / "strict.toml") << "schema = 1\nname = \"strict\"\n[limits]\nemd_bins = 0.01\n";
    const Said stricter = run("hordctl", {"replay", "--store", store, "--json", "--recipe", folder / "strict.toml"});
    EXPECT_EQ(stricter.status, 1);
    EXPECT_THAT(stricter.out, HasSubstr("\"changes\":[\"verdict\""));

    const auto replay_to = [&](const std::string& name, const std::vector<std::string>& more) {
        std::vector<std::string> arguments{"replay", "--store", store, "--out", folder / name};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return run("hordctl", arguments).status;
    };
    EXPECT_EQ(replay_to("all.jsonl", {"--jobs", "2"}), 0);
    for (const std::string shard : {"3/3", "1/3", "2/3"})
        EXPECT_EQ(replay_to(shard.substr(0, 1) + ".jsonl", {"--shard", shard}), 0);
    const Said merged =
        run("hordctl",
            {"merge", folder / "3.jsonl", folder / "1.jsonl", folder / "2.jsonl", "--out", folder / "merged.jsonl"});
    EXPECT_EQ(merged.status, 0) << merged.err;
    const auto bytes_of = [&](const std::string& name) {
        std::ifstream in(folder / name, std::ios::binary);
        return std::string(std::istreambuf_iterator<char>(in), {});
    };
    EXPECT_EQ(bytes_of("merged.jsonl"), bytes_of("all.jsonl"));
    EXPECT_THAT(bytes_of("all.jsonl"), HasSubstr(replayed.out));
    for (const std::string wrong : {"4/3", "x", "1/99999999999999999999"}) {
        const Said refused =
            run("hordctl", {"replay", "--store", store, "--shard=" + wrong, "--out", folder / "no.jsonl"});
        EXPECT_EQ(refused.status, 2) << wrong;
        EXPECT_THAT(refused.err, HasSubstr("shard")) << wrong;
    }
    EXPECT_FALSE(fs::exists(folder / "no.jsonl"));

    // A second run continues the numbering. A truncated frame is named and the others are still judged.
    ASSERT_EQ(produce(folder, 3).status, 0);
    EXPECT_THAT(run("hordctl", {"results", "verify", "--store", store}).out, HasSubstr("results: 15 rows, 1 to 15"));
    const fs::path frame = *fs::directory_iterator(fs::path(store) / "frames");
    for (const std::string& read : {frame.string(), store + "/results.db", folder / "strict.toml"}) {
        const Said same =
            run("hordctl", {"replay", "--store", store, "--recipe", folder / "strict.toml", "--out", read});
        EXPECT_EQ(same.status, 2);
        EXPECT_THAT(same.err, HasSubstr(read + " is one of the files that are read"));
    }
    fs::resize_file(frame, fs::file_size(frame) / 2);
    const Said torn = run("hordctl", {"replay", "--store", store});
    EXPECT_EQ(torn.status, 2);
    EXPECT_THAT(torn.err, HasSubstr(frame.filename().string()));
}

TEST(Store, is_replayed_to_the_same_bytes_by_workers_of_which_one_is_killed_and_run_again) {
    const TemporaryFolder folder;
    const std::string store = folder / "store";
    ASSERT_EQ(run("hord_test_archive", {store, "60"}).status, 0);
    const auto unfinished = [&] {
        return std::any_of(fs::directory_iterator(folder.path()), {}, [](const fs::directory_entry& entry) {
            return entry.path().string().find("2.jsonl.part.") != std::string::npos;
        });
    };
    bool killed = false;
    for (int attempt = 0; attempt < 20 && !killed; ++attempt) {
        fs::remove(folder / "2.jsonl");
        Running worker("hordctl", {"replay", "--store", store, "--shard", "2/2", "--out", folder / "2.jsonl"});
        while (!unfinished() && !fs::exists(folder / "2.jsonl")) std::this_thread::yield();
        killed = worker.stop(SIGKILL).status == 128 + SIGKILL && !fs::exists(folder / "2.jsonl");
    }
    ASSERT_TRUE(killed);
    ASSERT_EQ(run("hordctl", {"replay", "--store", store, "--shard", "1/2", "--out", folder / "1.jsonl"}).status, 0);
    const std::vector<std::string> merge{"merge", folder / "1.jsonl", folder / "2.jsonl", "--out",
                                         folder / "merged.jsonl"};
    const Said early = run("hordctl", merge);
    EXPECT_EQ(early.status, 2);
    EXPECT_THAT(early.err, HasSubstr("2.jsonl cannot be read"));
    ASSERT_EQ(run("hordctl", {"replay", "--store", store, "--shard", "2/2", "--out", folder / "2.jsonl"}).status, 0);
    ASSERT_EQ(run("hordctl", merge).status, 0);
    ASSERT_EQ(run("hordctl", {"replay", "--store", store, "--out", folder / "all.jsonl"}).status, 0);
    const auto bytes_of = [&](const std::string& name) {
        std::ifstream in(folder / name, std::ios::binary);
        return std::string(std::istreambuf_iterator<char>(in), {});
    };
    EXPECT_EQ(bytes_of("merged.jsonl"), bytes_of("all.jsonl"));
}

TEST(Store, names_the_present_name_of_a_reason_that_was_renamed) {
    const TemporaryFolder folder;
    EXPECT_THAT(run("hordctl", {"results", "--store", folder / "none", "--reason", "slope"}).err,
                HasSubstr("the reason \"slope\" is called \"deflection-gradient\" now"));
}

TEST(Store, that_cannot_be_opened_is_a_fault_and_the_line_goes_on) {
    const TemporaryFolder folder;
    fs::create_directories(folder / "store");
    std::ofstream(folder / "store/results.db") << std::string(10'000, 'x');
    const Said said = produce_as_a_service(folder, 5);
    EXPECT_EQ(said.status, 3) << said.err;
    EXPECT_EQ(lines(said.out), 5U) << said.out;
    EXPECT_THAT(said.err, HasSubstr("results.db is damaged"));
    EXPECT_THAT(said.err, HasSubstr("5 results (sequences 1 to 5)"));
    EXPECT_THAT(said.err, HasSubstr("could not be stored before the end"));
    EXPECT_THAT(said.err, HasSubstr("move the file"));
    EXPECT_EQ(fs::file_size(folder / "store/results.db"), 10'000U);  // unchanged
    EXPECT_EQ(run("hordctl", {"results", "--store", folder / "store"}).status, 2);
}

TEST(Store, on_a_path_that_the_disk_does_not_answer_for_is_a_fault_and_the_line_goes_on) {
    const TemporaryFolder folder;
    fs::create_symlink("store", folder / "store");  // ELOOP: a status that is neither "there" nor "not there"
    const Said said = produce_as_a_service(folder, 3);
    EXPECT_EQ(said.status, 3) << said.err;
    EXPECT_EQ(lines(said.out), 3U) << said.out;
    EXPECT_THAT(said.err, HasSubstr("cannot be made or used"));
    EXPECT_THAT(said.err, HasSubstr("3 results (sequences 1 to 3)"));
}

TEST(Store, named_with_store_that_cannot_be_used_is_refused_before_the_parts_are_rendered) {
    const TemporaryFolder folder;
    std::ofstream(folder / "store") << "a file";
    const Said said = produce(folder, 3);
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("cannot be made or used"));
    EXPECT_THAT(said.err, testing::Not(HasSubstr("render")));
    EXPECT_THAT(
        run("hordctl", {"run", "--simulate", "--parts", "1", "--modbus", "127.0.0.1:0", "--out", folder / "store"}).err,
        HasSubstr("cannot be created"));
}

TEST(Store, of_another_station_that_runs_is_not_touched) {
    const TemporaryFolder folder;
    Running first("hordctl",
                  {"run", "--simulate", "--variety", "1", "--rate", "2", "--modbus", "127.0.0.1:0", "--json", "--store",
                   folder / "store"});
    ASSERT_TRUE(first.says("\"part\":1", std::chrono::seconds(120))) << first.so_far().err;
    const Said second = produce(folder, 2);
    EXPECT_THAT(second.err, HasSubstr("is in use by process " + std::to_string(first.pid()) + " (hordctl)"));
    EXPECT_EQ(second.status, 2);
    first.stop(SIGINT);  // any status: a busy machine can make it late, and then it stops its line
    EXPECT_EQ(run("hordctl", {"results", "verify", "--store", folder / "store"}).status, 0);
}

}  // namespace
}  // namespace hord::test
