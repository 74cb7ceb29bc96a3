#include "firmware/station/state_lock.h"

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "tests/support/temp_folder.h"

namespace hord::firmware {
namespace {

using testing_support::TempFolder;

TEST(StateLock, a_second_station_is_refused_and_told_who_holds_the_folder) {
    const TempFolder folder;
    auto first = StateLock::take(folder.path());
    ASSERT_TRUE(first && first->held());
    const auto second = StateLock::take(folder.path());
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, ErrorCode::busy);
    EXPECT_EQ(second.error().message(),
              "state folder " + folder.path().string() + " is in use by process " + std::to_string(::getpid()) + " (" +
                  program_invocation_short_name + "): stop it or name another folder");
    *first = StateLock();
    EXPECT_TRUE(StateLock::take(folder.path()).value().held()) << "the file of the last owner locks nothing";
}

// A folder in the file's place stands for a disk that can neither be written nor read.
TEST(StateLock, a_folder_that_cannot_be_written_is_no_reason_to_refuse_the_start) {
    const TempFolder folder;
    EXPECT_FALSE(StateLock::take(folder.path() / "gone").value().held());
    std::filesystem::create_directories(folder.path() / "station.lock");
    const auto lock = StateLock::take(folder.path());
    ASSERT_TRUE(lock) << lock.error().message();
}

}  // namespace
}  // namespace hord::firmware
