// A station whose folder of state or results another station uses.
#include <chrono>
#include <csignal>
#include <filesystem>
#include <string>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include "tests/system/cli/program.h"
#include "tests/system/cli/service_fixture.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST_F(Service, a_second_station_on_the_same_state_folder_is_refused_before_it_writes) {
    write_config("[station]\nautostart = false\n");
    const auto state = folder.path() / "state";
    std::filesystem::create_directories(state);
    const std::vector<std::string> arguments = under({"STATE_DIRECTORY=" + state.string()});
    Running service("/usr/bin/env", arguments);
    ASSERT_TRUE(service.says("Preoperational to Initialized", kPatience)) << service.so_far().err;
    const std::string why = "state folder " + state.string() + " is in use by process ";
    const Said second = run("/usr/bin/env", arguments);
    EXPECT_EQ(second.status, 2);
    EXPECT_THAT(second.err, HasSubstr(why));
    const Said simulated =
        run("hordctl", {"run", "--simulate", "--parts", "1", "--modbus", "127.0.0.1:0", "--state", state});
    EXPECT_EQ(simulated.status, 2);
    EXPECT_THAT(simulated.err, HasSubstr(why));
    EXPECT_THAT(simulated.err, HasSubstr("(hordd): stop it or name another folder"));
    EXPECT_FALSE(std::filesystem::exists(state / "line-empty")) << "a false proof";
}

// The first is killed: a crash must not leave the folder locked.
TEST_F(Service, a_second_station_on_the_same_store_is_refused_until_the_first_has_ended) {
    const auto store = folder.path() / "store";
    write_config("[station]\nautostart = false\n[store]\nfolder = \"" + store.string() + "\"\n");
    Running first("/usr/bin/env", under({}));
    ASSERT_TRUE(first.says("Preoperational to Initialized", kPatience)) << first.so_far().err;
    // Its store is opened by a thread of its own.
    const auto until = std::chrono::steady_clock::now() + kPatience;
    while (run("hordctl", {"results", "--store", store}).status != 0 && std::chrono::steady_clock::now() < until) {
    }
    const std::string why = "the store's folder " + store.string() + " is in use by process ";
    const Said second = run("/usr/bin/env", under({}));
    EXPECT_EQ(second.status, 2);
    EXPECT_THAT(second.err, HasSubstr(why));
    const Said simulated =
        run("hordctl", {"run", "--simulate", "--parts", "1", "--modbus", "127.0.0.1:0", "--store", store});
    const std::string first_one = why + std::to_string(first.pid()) + " (hordd)";
    EXPECT_EQ(simulated.status, 2);
    EXPECT_THAT(simulated.err, HasSubstr(first_one));
    const Said checked = run("/usr/bin/env", under({}, {"--check"}));
    EXPECT_EQ(checked.status, 0) << checked.err;
    EXPECT_THAT(checked.out, HasSubstr("note: " + first_one + "\n"));
    EXPECT_EQ(run("hordctl", {"results", "--store", store}).status, 0) << "readers go on";
    EXPECT_EQ(run("hordctl", {"results", "verify", "--store", store}).status, 0);
    first.stop(SIGKILL);
    EXPECT_THAT(run("/usr/bin/env", under({}, {"--check"})).out, Not(HasSubstr("is in use by")));
    Running again("/usr/bin/env", under({}));
    EXPECT_TRUE(again.says("Preoperational to Initialized", kPatience)) << again.so_far().err;
}

// Before the first has opened its store, or after: the lock is the folder's.
TEST_F(Service, a_second_station_on_the_same_store_is_refused_without_the_files_of_the_lock) {
    const auto store = folder.path() / "store";
    write_config("[station]\nautostart = false\n[store]\nfolder = \"" + store.string() + "\"\n");
    Running first("/usr/bin/env", under({}));
    const auto until = std::chrono::steady_clock::now() + kPatience;
    while (!std::filesystem::remove(store / "station.lock") && std::chrono::steady_clock::now() < until)
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    for (int k = 0; k < 2; ++k) {
        const Said second = run("/usr/bin/env", under({}));
        EXPECT_EQ(second.status, 2);
        EXPECT_THAT(second.err, HasSubstr("the store's folder " + store.string() + " is in use by another process"));
        ASSERT_TRUE(first.says("Preoperational to Initialized", kPatience)) << first.so_far().err;
        std::filesystem::remove(store / "lock");
    }
    EXPECT_EQ(first.stop(SIGTERM).status, 0);
}

// Whoever asked who holds the folder waited for a writer of the pipe.
TEST_F(Service, is_refused_and_not_waited_for_where_a_pipe_is_in_the_place_of_its_lock) {
    const auto state = folder.path() / "state", store = folder.path() / "store";
    write_config("[store]\nfolder = \"" + store.string() + "\"\n");
    for (const auto& holder : {state, store}) {
        std::filesystem::create_directories(state);
        std::filesystem::create_directories(store);
        const auto lock = holder / "station.lock";
        std::filesystem::remove(lock);
        ASSERT_EQ(::mkfifo(lock.c_str(), 0600), 0);
        const auto says = HasSubstr(lock.string() + " is a pipe, not a regular file: remove it");
        const Said check = run("/usr/bin/env", under({"STATE_DIRECTORY=" + state.string()}, {"--check"}));
        EXPECT_EQ(check.status, 78) << check.err;
        EXPECT_THAT(check.err, says);
        const Said start = run("/usr/bin/env", under({"STATE_DIRECTORY=" + state.string()}));
        EXPECT_EQ(start.status, 2) << start.err;
        EXPECT_THAT(start.err, says);
        std::filesystem::remove(lock);
    }
}

TEST_F(Service, may_store_its_results_in_the_state_folder_itself) {
    const auto state = folder.path() / "state";
    std::filesystem::create_directories(state);
    write_config("[station]\nautostart = false\n[store]\nfolder = \"" + state.string() + "\"\n");
    Running service("/usr/bin/env", under({"STATE_DIRECTORY=" + state.string()}));
    EXPECT_TRUE(service.says("Preoperational to Initialized", kPatience)) << service.so_far().err;
}

}  // namespace
}  // namespace hord::test
