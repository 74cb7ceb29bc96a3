#include "common/file_writing.h"

#include <cerrno>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/dangling_link.h"
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

TEST(WholeFile, of_a_pipe_is_waited_for) {
    const TempFolder folder;
    const auto pipe = folder.path() / "pipe";
    ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
    EXPECT_FALSE(read_file(pipe));  // nobody writes
    EXPECT_EQ(errno, ENODATA);
    EXPECT_EQ(cannot_read(pipe).message(), pipe.string() + " is a pipe, not a regular file: give a regular file");
    int ends[2];
    ASSERT_EQ(::pipe(ends), 0);
    std::thread writer([&] {
        for (const char* piece : {"a", "b"}) {
            std::this_thread::yield();
            EXPECT_EQ(::write(ends[1], piece, 1), 1);
        }
        ::close(ends[1]);
    });
    EXPECT_EQ(read_file("/proc/self/fd/" + std::to_string(ends[0])), "ab");
    writer.join();
    ::close(ends[0]);
}

TEST(WholeFile, is_no_device_and_no_larger_than_it_can_be) {
    const TempFolder folder;
    for (const char* device : {"/dev/zero", "/dev/null", "/dev/ptmx"}) {
        EXPECT_FALSE(read_file(device));
        EXPECT_EQ(cannot_read(device).message(),
                  device + std::string(" is a device, not a regular file: give a regular file"));
    }
    const auto large = folder.write("large", "");
    std::filesystem::resize_file(large, kMaxText + 1);  // not a byte of it is on the disk
    EXPECT_FALSE(read_file(large, kMaxText));
    EXPECT_EQ(errno, EFBIG);
    EXPECT_EQ(cannot_read(large).cure, "it is larger than such a file can be, or never ends: give another file");
    std::filesystem::resize_file(large, kMaxText);
    EXPECT_EQ(read_file(large, kMaxText).value_or("").size(), kMaxText);
}

TEST(WholeFile, that_is_replaced_keeps_owner_group_and_mode) {
    const TempFolder folder;
    const auto file = folder.write("kept", "old");
    for (const mode_t mode : {0600U, 0640U, 0664U}) {
        ASSERT_EQ(::chmod(file.c_str(), mode), 0);
        struct stat before {
        }, after{};
        if (::geteuid() == 0) {  // others cannot give files away
            ASSERT_EQ(::chown(file.c_str(), 1234, 2345), 0);
        }
        ASSERT_EQ(::stat(file.c_str(), &before), 0);
        ASSERT_TRUE(mode == 0640 ? write_atomically(file, Bytes{1}) : write_durably(file, "new"));
        ASSERT_EQ(::stat(file.c_str(), &after), 0);
        EXPECT_EQ(after.st_mode & 0777, mode);
        EXPECT_EQ(after.st_uid, before.st_uid);
        EXPECT_EQ(after.st_gid, before.st_gid);
    }
}

TEST(WholeFile, replaces_no_link_no_pipe_and_no_folder) {
    const TempFolder folder;
    const auto kept = folder.write("kept", "kept"), link = folder.path() / "link", pipe = folder.path() / "pipe";
    std::filesystem::create_symlink(kept, link);
    ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
    for (const auto& [file, what] :
         {std::pair(link, "symbolic link"), std::pair(pipe, "pipe"), std::pair(folder.path(), "folder"),
          std::pair(std::filesystem::path("/dev/null"), "device")}) {
        for (const auto& done : {write_atomically(file, Bytes{1}), write_durably(file, "1")}) {
            ASSERT_FALSE(done);
            EXPECT_EQ(done.error().code, ErrorCode::refused);
            EXPECT_THAT(done.error().what, testing::AllOf(HasSubstr(file.string()), HasSubstr(what)));
        }
    }
    EXPECT_TRUE(std::filesystem::is_symlink(link));
    EXPECT_TRUE(std::filesystem::is_fifo(pipe));
    EXPECT_TRUE(std::filesystem::is_character_file("/dev/null"));
    EXPECT_EQ(TempFolder::read(kept), "kept");
}

TEST(WholeFile, replaces_the_old_one_or_leaves_it_and_nothing_beside_it) {
    const TempFolder folder;
    const auto file = folder.path() / "f";
    ASSERT_TRUE(write_atomically(file, Bytes{1, 2, 3}));
    ASSERT_TRUE(write_atomically(file, Bytes{4}));
    EXPECT_EQ(TempFolder::read(file), "\x04");
    const auto nowhere = folder.path() / "no" / "f";
    for (const auto& done : {write_atomically(nowhere, Bytes{1}), write_durably(nowhere, "1")}) {
        ASSERT_FALSE(done);
        EXPECT_EQ(done.error().code, ErrorCode::not_found);
        EXPECT_THAT(done.error().what, HasSubstr(nowhere.parent_path().string()));
    }
    std::filesystem::create_directory(folder.path() / "taken");  // a folder is not replaced
    const auto taken = write_atomically(folder.path() / "taken", Bytes{1});
    ASSERT_FALSE(taken);
    EXPECT_EQ(taken.error().code, ErrorCode::refused);
    EXPECT_THAT(taken.error().what, HasSubstr((folder.path() / "taken").string()));
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
        names.push_back(entry.path().filename());
    EXPECT_THAT(names, testing::UnorderedElementsAre("f", "taken"));
}

TEST(WholeFile, of_two_writers_at_the_same_time_the_last_one_has_written_it) {
    const TempFolder folder;
    const auto file = folder.path() / "f";
    const auto write = [&](std::uint8_t value) {
        for (int k = 0; k < 200; ++k) EXPECT_TRUE(write_atomically(file, Bytes(1000U * value, value)));
    };
    std::thread other(write, 1);
    write(2);
    other.join();
    const std::string text = TempFolder::read(file);
    ASSERT_FALSE(text.empty());
    EXPECT_EQ(text, std::string(1000U * static_cast<unsigned char>(text[0]), text[0]));
}

TEST(DanglingLink, is_named_with_what_it_leads_to_wherever_it_stands_in_the_path) {
    const TempFolder folder;
    const auto link = folder.path() / "link";
    std::filesystem::create_symlink("nowhere", link);
    const std::string why = link.string() + " is a symbolic link to nowhere, which does not exist";
    EXPECT_EQ(dangling_link(link), why);
    EXPECT_EQ(dangling_link(link / "a" / "b"), why);
    EXPECT_FALSE(read_file(link));
    EXPECT_THAT(cannot_read(link).what, HasSubstr(why));
    EXPECT_EQ(dangling_link(folder.path() / "missing"), "");
    std::filesystem::create_directory(folder.path() / "nowhere");
    EXPECT_EQ(dangling_link(link / "a"), "");
}

}  // namespace
}  // namespace hord::common
