// A store whose files belong to root, as a station run there by root leaves them, and a service of another user.
#include "firmware/store/results/store_rights.h"

#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "firmware/store/results/sqlite_store.h"
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

}  // namespace
}  // namespace hord::firmware::store
