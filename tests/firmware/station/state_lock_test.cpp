#include "firmware/station/state_lock.h"

#include <fstream>
#include <string>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "common/unique_fd.h"
#include "tests/support/temp_folder.h"

namespace hord::firmware {
namespace {

using testing_support::TempFolder;

// A process that holds the lock until it is let go, and knows whether it got it.
class Holder {
  public:
    explicit Holder(const std::filesystem::path& folder) {
        int told[2], ended[2];
        if (::pipe(told) != 0 || ::pipe(ended) != 0) return;
        pid_ = ::fork();
        if (pid_ == 0) {
            ::close(ended[1]);
            const auto lock = StateLock::take(folder);
            const char holds = lock && lock->held() ? 'y' : 'n';
            (void)!::write(told[1], &holds, 1);
            char end = 0;
            (void)!::read(ended[0], &end, 1);
            ::_exit(0);
        }
        ::close(told[1]);
        ::close(ended[0]);
        let_go_ = ended[1];
        char holds = 'n';
        holds_ = ::read(told[0], &holds, 1) == 1 && holds == 'y';
        ::close(told[0]);
    }
    ~Holder() {
        ::close(let_go_);
        ::waitpid(pid_, nullptr, 0);
    }
    Holder(const Holder&) = delete;
    Holder& operator=(const Holder&) = delete;

    [[nodiscard]] bool holds() const { return holds_; }
    [[nodiscard]] std::string name() const {
        return "process " + std::to_string(pid_) + " (" + std::string(program_invocation_short_name).substr(0, 15) +
            ")";
    }

  private:
    pid_t pid_ = -1;
    int let_go_ = -1;
    bool holds_ = false;
};

TEST(StateLock, a_second_station_is_refused_and_told_who_holds_the_folder) {
    const TempFolder folder;
    const std::string in_use = "state folder " + folder.path().string() + " is in use by ";
    EXPECT_EQ(StateLock::in_use(folder.path()), std::nullopt);
    {
        const Holder first(folder.path());
        ASSERT_TRUE(first.holds());
        for (int k = 0; k < 2; ++k) {
            const auto second = StateLock::take(folder.path());
            ASSERT_FALSE(second);
            EXPECT_EQ(second.error().code, ErrorCode::busy);
            EXPECT_EQ(second.error().message(), in_use + first.name() + ": stop it or name another folder");
            EXPECT_EQ(StateLock::in_use(folder.path()), in_use + first.name());
        }
    }
    EXPECT_EQ(StateLock::in_use(folder.path()), std::nullopt);
    EXPECT_TRUE(StateLock::take(folder.path()).value().held()) << "the file of the last owner locks nothing";
}

// The lock is the folder's: the file only tells who holds it.
TEST(StateLock, is_held_where_its_file_was_removed) {
    const TempFolder folder;
    const Holder first(folder.path());
    ASSERT_TRUE(first.holds());
    ASSERT_TRUE(std::filesystem::remove(folder.path() / "station.lock"));
    const auto second = StateLock::take(folder.path());
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, ErrorCode::busy);
    EXPECT_EQ(second.error().what, "state folder " + folder.path().string() + " is in use by another process");
    EXPECT_TRUE(std::filesystem::is_empty(folder.path())) << "whoever is refused writes nothing";
}

// The holder may read the file, and not write it; what it says is of an earlier one.
TEST(StateLock, a_file_of_another_user_names_its_holder_and_no_earlier_one) {
    const TempFolder folder;
    const auto file = folder.path() / "station.lock";
    std::ofstream(file) << "1 (init)";
    ASSERT_EQ(::chmod(file.c_str(), 0444), 0);
    const Holder first(folder.path());
    ASSERT_TRUE(first.holds());
    const auto second = StateLock::take(folder.path());
    ASSERT_FALSE(second);
    EXPECT_THAT(second.error().what, testing::EndsWith(" is in use by " + first.name()));
}

TEST(StateLock, whose_holder_is_not_known_names_no_process) {
    const TempFolder folder;
    const auto file = folder.path() / "station.lock";
    std::ofstream(file) << "1 (init)";
    const common::UniqueFd other(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
    ASSERT_EQ(::flock(other.get(), LOCK_EX | LOCK_NB), 0);
    const auto second = StateLock::take(folder.path());
    ASSERT_FALSE(second);
    EXPECT_THAT(second.error().what, testing::EndsWith(" is in use by another process"));
}

// A folder in the file's place stands for a disk that can neither be written nor read.
TEST(StateLock, a_folder_that_cannot_be_written_is_no_reason_to_refuse_the_start) {
    const TempFolder folder;
    EXPECT_FALSE(StateLock::take(folder.path() / "gone").value().held());
    std::filesystem::create_directories(folder.path() / "station.lock");
    const auto lock = StateLock::take(folder.path());
    ASSERT_TRUE(lock) << lock.error().message();
}

// Who asks who holds the folder would wait for a writer of the pipe, for ever.
TEST(StateLock, a_pipe_in_the_place_of_its_file_is_named_and_never_waited_for) {
    const TempFolder folder;
    const auto file = folder.path() / "station.lock";
    ASSERT_EQ(::mkfifo(file.c_str(), 0600), 0);
    EXPECT_EQ(StateLock::in_use(folder.path()), std::nullopt);
    const auto lock = StateLock::take(folder.path());
    ASSERT_FALSE(lock);
    EXPECT_EQ(lock.error().code, ErrorCode::refused);
    EXPECT_EQ(lock.error().message(),
              file.string() + " is a pipe, not a regular file: remove it: the station makes its lock there");
}

TEST(StateLock, tells_that_its_folder_is_at_its_place_no_more) {
    const TempFolder folder;
    const auto path = folder.path() / "state", moved = folder.path() / "moved";
    std::filesystem::create_directory(path);
    const auto lock = StateLock::take(path);
    ASSERT_TRUE(lock);
    EXPECT_TRUE(lock->check_place());
    std::filesystem::rename(path, moved);
    EXPECT_FALSE(lock->check_place());
    std::filesystem::create_directory(path);
    ASSERT_FALSE(lock->check_place());
    EXPECT_EQ(lock->check_place().error().code, ErrorCode::refused);
    EXPECT_THAT(lock->check_place().error().what, testing::HasSubstr(path.string() + " was renamed or removed"));
    std::filesystem::remove_all(path);
    std::filesystem::create_directory_symlink(moved, path);
    EXPECT_TRUE(lock->check_place()) << "the same folder by another way";
}

}  // namespace
}  // namespace hord::firmware
