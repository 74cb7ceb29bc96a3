// States for a reader that takes nothing for a while. Messages, all of which count: journal_socket_test.cpp.
#include "common/datagram_queue.h"

#include <filesystem>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "tests/support/datagram_reader.h"

namespace hord::common {
namespace {

using ::testing::ElementsAre;

class States : public ::testing::Test {
  protected:
    States() { std::filesystem::remove(path_); }
    ~States() override { std::filesystem::remove(path_); }
    States(const States&) = delete;
    States& operator=(const States&) = delete;

    const std::string path_ = ::testing::TempDir() + "states-" + std::to_string(::getpid());
    DatagramQueue queue_{path_};
};

TEST_F(States, that_nobody_took_give_way_to_the_newest_of_their_name) {
    queue_.send_newest("READY=1");
    queue_.send_newest("STATUS=a");
    queue_.send_newest("WATCHDOG=1");
    queue_.send_newest("RELOADING=1\nMONOTONIC_USEC=5");
    queue_.send_newest("STATUS=b = c");
    queue_.send_newest("WATCHDOG=1");
    queue_.send_newest("RELOADING=1\nMONOTONIC_USEC=7");
    testing_support::DatagramReader reader(path_);
    queue_.flush();
    EXPECT_THAT(reader.read(), ElementsAre("READY=1", "STATUS=b = c", "WATCHDOG=1", "RELOADING=1\nMONOTONIC_USEC=7"));
    queue_.send_newest("READY=1");
    EXPECT_THAT(reader.read(), ElementsAre("READY=1"));
}

// A service that says what it does once a second, for an hour: the end of a reload was lost after 1,000 of them.
TEST_F(States, are_not_lost_behind_thousands_of_others) {
    for (int k = 0; k < 4000; ++k) queue_.send_newest("STATUS=" + std::to_string(k));
    queue_.send_newest("READY=1");
    EXPECT_EQ(queue_.lost(), 0U);
    testing_support::DatagramReader reader(path_);
    queue_.flush();
    EXPECT_THAT(reader.read(), ElementsAre("STATUS=3999", "READY=1"));
}

}  // namespace
}  // namespace hord::common
