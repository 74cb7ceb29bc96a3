// A store whose files belong to root, as a station run there by root leaves them, and a service of another user.
#include "firmware/store/results/store_rights.h"

#include <filesystem>
#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/store/results/sqlite_store.h"
#include "firmware/store/results/store_reader.h"
#include "tests/support/temp_folder.h"

namespace hord::firmware::store {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

TEST(StoreRights, of_another_user_are_told_with_every_file_that_must_change) {
    if (::geteuid() != 0) GTEST_SKIP() << "needs root, to be another user";
    const testing_support::TempFolder root;
    const fs::path folder = root.path() / "store";
    ASSERT_TRUE(open_sqlite_store(folder));
    EXPECT_TRUE(check_rights(folder));
    fs::permissions(root.path(), fs::perms{0755});
    fs::permissions(folder, fs::perms{0777});  // the folder alone was given to the user
    ASSERT_EQ(::seteuid(65534), 0);
    const auto checked = check_rights(folder);
    const auto opened = open_sqlite_store(folder);
    ASSERT_EQ(::seteuid(0), 0);
    ASSERT_FALSE(checked);
    ASSERT_FALSE(opened);
    const std::string file = (folder / "results.db").string(), lock = (folder / "lock").string();
    EXPECT_THAT(checked.error().what, HasSubstr(lock + ", " + file + " cannot be written (Permission denied)"));
    EXPECT_THAT(opened.error().what, HasSubstr(lock + " cannot be written (Permission denied)"));
    for (const std::string& cure : {checked.error().cure, opened.error().cure})
        EXPECT_THAT(cure, AllOf(HasSubstr(folder.string() + " with lock, results.db, "), HasSubstr("chown -R")));

    ASSERT_EQ(::chown(lock.c_str(), 65534, 65534), 0);  // and then the lock
    ASSERT_EQ(::seteuid(65534), 0);
    const auto rest = check_rights(folder);
    const auto locked = open_sqlite_store(folder);
    ASSERT_EQ(::seteuid(0), 0);
    ASSERT_FALSE(locked) << "SQLite alone would open it to be read";
    EXPECT_THAT(locked.error().message(), AllOf(HasSubstr(file + " cannot be written ("), HasSubstr("chown -R")));
    ASSERT_FALSE(rest);
    EXPECT_EQ(rest.error().what, file + " cannot be written (Permission denied)");
}

// SQLite opens it without O_NONBLOCK: the page waited for ever, and could not be ended.
TEST(StoreFiles, that_are_pipes_or_folders_are_named_and_never_waited_for) {
    for (const char* const name : {"results.db", "results.db-wal", "results.db-shm", "results.db-journal", "lock"}) {
        for (const bool is_pipe : {true, false}) {
            const testing_support::TempFolder folder;
            const fs::path file = folder.path() / name;
            if (std::string(name) != "results.db") std::ofstream(folder.path() / "results.db").put('x');
            if (is_pipe) ASSERT_EQ(::mkfifo(file.c_str(), 0600), 0);
            else fs::create_directory(file);
            const std::string says = file.string() + (is_pipe ? " is a pipe" : " is a folder") +
                ", not a regular file: move it out of the folder: the station makes a new one";
            const auto checked = check_files(folder.path());
            ASSERT_FALSE(checked);
            EXPECT_EQ(checked.error().message(), says);
            const auto opened = open_sqlite_store(folder.path());
            ASSERT_FALSE(opened);
            EXPECT_EQ(opened.error().message(), says);
            EXPECT_TRUE(check_not_written(folder.path()));
            if (std::string(name) == "lock") continue;  // readers do not open it
            const auto read = StoreReader::open(folder.path());
            ASSERT_FALSE(read);
            EXPECT_EQ(read.error().message(), says);
        }
    }
}

TEST(StoreFiles, behind_a_link_are_made_where_its_folder_is_there) {
    const testing_support::TempFolder folder, other;
    const fs::path link = folder.path() / "results.db", target = other.path() / "disk" / "r.db";
    fs::create_symlink(target, link);
    const auto checked = check_files(folder.path());
    ASSERT_FALSE(checked);
    EXPECT_EQ(checked.error().what,
              link.string() + " is a symbolic link to " + target.string() + ", which does not exist");
    const auto opened = open_sqlite_store(folder.path());
    ASSERT_FALSE(opened);
    EXPECT_EQ(opened.error().message(), checked.error().message());
    EXPECT_EQ(StoreReader::open(folder.path()).error().what, checked.error().what);
    fs::create_directory(target.parent_path());
    EXPECT_TRUE(check_files(folder.path()));
    EXPECT_TRUE(open_sqlite_store(folder.path()));
    EXPECT_TRUE(fs::exists(target));
}

}  // namespace
}  // namespace hord::firmware::store
