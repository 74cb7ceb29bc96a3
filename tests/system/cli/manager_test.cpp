// What the programs tell the service manager, also one that takes nothing for a while.
#include <csignal>
#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/system/cli/notify_socket.h"
#include "tests/system/cli/service_fixture.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;

TEST_F(Service, tells_its_manager_when_it_is_ready_what_it_does_and_that_it_lives) {
    write_config();
    NotifySocket manager(folder / "notify");
    Running service("/usr/bin/env", under({"NOTIFY_SOCKET=" + (folder / "notify"), "WATCHDOG_USEC=400000"}));
    EXPECT_NE(manager.hears("READY=1"), "") << service.so_far().err;
    EXPECT_THAT(manager.hears("STATUS=ContinuousExecution"),
                HasSubstr("; SIMULATED: part-sensor, strobe, sensor, rejector"));
    EXPECT_TRUE(service.says("simulated: part-sensor, strobe, sensor, rejector"));
    for (int k = 0; k < 3; ++k) EXPECT_NE(manager.hears("WATCHDOG=1"), "");
    service.signal(SIGTERM);
    EXPECT_NE(manager.hears("STOPPING=1"), "");
    EXPECT_EQ(service.stop(0).status, 0);
}

TEST_F(Service, does_not_wait_for_a_manager_that_takes_nothing_and_tells_it_later) {
    write_config();
    NotifySocket manager(folder / "notify");
    manager.fill();
    Running service("/usr/bin/env", under({"NOTIFY_SOCKET=" + (folder / "notify"), "WATCHDOG_USEC=400000"}));
    ASSERT_TRUE(service.says("Ready to ContinuousExecution", kPatience)) << service.so_far().err;
    EXPECT_NE(manager.hears("READY=1"), "") << "it was kept";
    EXPECT_NE(manager.hears("STATUS=ContinuousExecution"), "");
    manager.fill();
    EXPECT_EQ(service.stop(SIGTERM).status, 0);
}

// It has nobody to tell: neither broker nor station answers.
TEST_F(Service, that_hands_results_to_a_broker_ends_beside_a_manager_that_takes_nothing) {
    std::ofstream(folder / "mqtt.toml")
        << "[broker]\nport = 1\n[station]\nmodbus = \"127.0.0.1:1\"\n[results]\nstore = \"" << folder / "store"
        << "\"\nstate_file = \"cursor\"\n";
    NotifySocket manager(folder / "notify");
    manager.fill();
    Running mqtt("/usr/bin/env",
                 {"NOTIFY_SOCKET=" + (folder / "notify"), std::string(HORD_BIN_DIR) + "/hord-mqtt", "--config",
                  folder / "mqtt.toml"});
    ASSERT_TRUE(mqtt.says("broker localhost:1", kPatience)) << mqtt.so_far().err;
    EXPECT_NE(manager.hears("READY=1"), "") << "it was kept";
    EXPECT_NE(manager.hears("STATUS="), "");
    manager.fill();
    const Said said = mqtt.stop(SIGTERM);
    EXPECT_EQ(said.status, 0);
    EXPECT_THAT(said.err, HasSubstr("stopped as asked"));
}

}  // namespace
}  // namespace hord::test
