#include "common/file_writing.h"

#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/temp_folder.h"

namespace hord::common {
namespace {

using testing::HasSubstr;
using testing_support::TempFolder;
using Bytes = std::vector<std::uint8_t>;

TEST(WholeFile, is_read_to_its_end_or_not_at_all) {
    const TempFolder folder;
    ASSERT_TRUE(write_atomically(folder.path() / "f", Bytes{'a', 0, '\n'}));
    EXPECT_EQ(read_file(folder.path() / "f"), std::string("a\0\n", 3));
    EXPECT_FALSE(read_file(folder.path() / "none"));
    EXPECT_FALSE(read_file(folder.path()));
}

TEST(WholeFile, replaces_the_old_one_or_leaves_it_and_nothing_beside_it) {
    const TempFolder folder;
    const auto file = folder.path() / "f";
    ASSERT_TRUE(write_atomically(file, Bytes{1, 2, 3}));
    ASSERT_TRUE(write_atomically(file, Bytes{4}));
    EXPECT_EQ(TempFolder::read(file), "\x04");
    EXPECT_EQ(write_atomically(folder.path() / "no" / "f", Bytes{1}).error().code, ErrorCode::not_found);
    std::filesystem::create_directory(folder.path() / "taken");  // a folder is not replaced
    const auto taken = write_atomically(folder.path() / "taken", Bytes{1});
    ASSERT_FALSE(taken);
    EXPECT_EQ(taken.error().code, ErrorCode::io);
    EXPECT_THAT(taken.error().what, HasSubstr((folder.path() / "taken").string()));
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "taken.part"));
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "f.part"));
}

}  // namespace
}  // namespace hord::common
