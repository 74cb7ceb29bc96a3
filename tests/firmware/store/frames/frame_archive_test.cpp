// The ring of retained frames never fills the disk, and survives disks that answer with errors.

#include "firmware/store/frames/frame_archive.h"

#include "tests/firmware/store/frames/retained_parts.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(FrameArchive, keeps_the_newest_within_its_bytes_and_goes_on_counting_after_a_restart) {
    const TempFolder folder;
    const std::vector<std::uint8_t> bytes(1000, 1);
    const ArchiveLimits limits{.max_bytes = 3500, .min_free_bytes = 0};
    {
        auto archive = FrameArchive::open(folder.path() / "frames", limits);
        ASSERT_TRUE(archive) << archive.error().message();
        for (const char* label : {"a", "b", "c", "d", "e"}) ASSERT_TRUE((*archive)->add(label, bytes));
        EXPECT_EQ((*archive)->bytes(), 3000U);
    }
    EXPECT_THAT(names(folder.path() / "frames"),
                ElementsAre("000000000003-c.png", "000000000004-d.png", "000000000005-e.png"));
    auto archive = FrameArchive::open(folder.path() / "frames", limits);
    ASSERT_TRUE((*archive)->add("f", bytes));
    EXPECT_THAT(names(folder.path() / "frames"),
                ElementsAre("000000000004-d.png", "000000000005-e.png", "000000000006-f.png"));
    EXPECT_FALSE((*archive)->add("larger than all", std::vector<std::uint8_t>(4000)));
}

TEST(FrameArchive, leaves_the_disk_what_it_was_told_to_whatever_others_write) {
    const TempFolder folder;
    const std::vector<std::uint8_t> bytes(1000, 1);
    ArchiveDisk disk = real_disk();
    std::uint64_t others = 0;
    const auto used = [&] {
        std::uint64_t sum = others;
        const auto files = list_frames(folder.path());
        for (const ArchivedFile& file : *files) sum += file.bytes;
        return sum;
    };
    static constexpr std::uint64_t kDisk = 20'000, kFree = 5'000;
    disk.free_bytes = [&](const std::filesystem::path&) -> Result<std::uint64_t> {
        return kDisk - std::min(kDisk, used());
    };
    auto archive = FrameArchive::open(folder.path(), {.max_bytes = 1'000'000, .min_free_bytes = kFree}, disk);
    ASSERT_TRUE(archive);
    for (int k = 0; k < 40; ++k) {
        ASSERT_TRUE((*archive)->add("x", bytes));
        EXPECT_LE(used(), kDisk - kFree);
    }
    EXPECT_EQ((*archive)->count(), 15U);
    others = 10'500;  // other programs use the disk
    ASSERT_TRUE((*archive)->trim());
    EXPECT_EQ((*archive)->count(), 4U);
    others = 15'500;  // other programs fill the disk
    const auto added = (*archive)->add("x", bytes);
    ASSERT_FALSE(added);
    EXPECT_THAT(added.error().message(), HasSubstr("stay free"));
    EXPECT_EQ((*archive)->count(), 0U);
    others = 0;
    EXPECT_TRUE((*archive)->add("x", bytes));
}

TEST(FrameArchive, gives_its_room_to_results_and_leaves_it_to_them) {
    const TempFolder folder;
    const std::vector<std::uint8_t> bytes(1000, 1);
    static constexpr std::uint64_t kDisk = 10'000;
    std::uint64_t others = 0;
    ArchiveDisk disk = real_disk();
    disk.free_bytes = [&](const std::filesystem::path&) -> Result<std::uint64_t> {
        const auto files = list_frames(folder.path());
        std::uint64_t used = others;
        for (const ArchivedFile& file : *files) used += file.bytes;
        return kDisk - std::min(kDisk, used);
    };
    auto archive = FrameArchive::open(folder.path(), {.max_bytes = 1'000'000, .min_free_bytes = 0}, disk);
    ASSERT_TRUE(archive);
    EXPECT_TRUE((*archive)->leave_more_free(20'000)) << "there is none to remove";
    for (int k = 0; k < 12; ++k) ASSERT_TRUE((*archive)->add("x", bytes));
    EXPECT_EQ((*archive)->count(), 10U) << "they fill the disk";
    ASSERT_TRUE((*archive)->leave_more_free(1500));
    EXPECT_EQ((*archive)->count(), 8U);
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "000000000012-x.png")) << "the oldest are removed";
    ASSERT_TRUE((*archive)->add("y", bytes));
    EXPECT_EQ((*archive)->count(), 8U) << "the room stays free";
    others = 1500;  // the results took it
    ASSERT_TRUE((*archive)->leave_more_free(1500));
    EXPECT_EQ((*archive)->count(), 6U) << "2000 bytes stay free: 500 were left";
    others = kDisk;
    EXPECT_FALSE((*archive)->leave_more_free(1500));
    EXPECT_EQ((*archive)->count(), 0U);
    EXPECT_FALSE((*archive)->add("z", bytes)) << "no frame before there is room";
    for (int k = 0; k < 5; ++k) EXPECT_FALSE((*archive)->leave_more_free(1500));
    others = kDisk - 4000;
    EXPECT_TRUE((*archive)->add("z", bytes)) << "without frames, nothing more was asked of them";
    others = kDisk;
    EXPECT_FALSE((*archive)->leave_more_free(1'500'000));
    const auto refused = (*archive)->add("z", bytes);
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().what, HasSubstr("has 0.0 MB left, and 1.5 MB are to stay free for results"));
    EXPECT_EQ(refused.error().cure, "free space on it") << "store.free_mb, which is 0, did not ask for it";
}

TEST(FrameArchive, removes_what_a_crash_left_unfinished_and_nothing_else) {
    const TempFolder folder;
    write_text(folder.path() / "000000000007-x.png", "whole");
    write_text(folder.path() / "000000000008-y.png.part", "half");
    write_text(folder.path() / "probe.png.part", "a probe");
    write_text(folder.path() / "notes.txt", "mine");
    auto archive = FrameArchive::open(folder.path(), {});
    ASSERT_TRUE(archive);
    EXPECT_EQ((*archive)->next_number(), 8U);
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "000000000008-y.png.part"));
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "probe.png.part"));
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "notes.txt"));
}

TEST(FrameArchive, a_folder_that_became_a_file_is_told_as_that_and_not_as_a_broken_disk) {
    const TempFolder folder;
    const std::filesystem::path store = folder.path() / "store";
    std::filesystem::create_directory(store);
    auto archive = FrameArchive::open(store / "frames", {.max_bytes = 1'000'000, .min_free_bytes = 0});
    ASSERT_TRUE(archive);
    const std::vector<std::uint8_t> bytes(10);
    std::filesystem::remove_all(store);
    EXPECT_THAT((*archive)->add("x", bytes).error().message(), HasSubstr("is gone (something removed it)"));
    write_text(store, "a file");
    EXPECT_THAT((*archive)->add("x", bytes).error().message(), HasSubstr("is gone: a file is in its place"));
    std::filesystem::remove(store);
    std::filesystem::create_directory(store);
    write_text(store / "frames", "a file");
    EXPECT_THAT((*archive)->add("x", bytes).error().message(), HasSubstr("is gone: a file is in its place"));
}

TEST(FrameArchive, names_the_file_that_a_disk_refuses) {
    const TempFolder folder;
    auto kept = FrameArchive::open(folder.path(), {.max_bytes = 1000, .min_free_bytes = 0});
    ASSERT_TRUE(kept);
    const std::vector<std::uint8_t> bytes(10);
    ASSERT_TRUE((*kept)->add("x", bytes));
    const std::string first = names(folder.path()).front();
    const std::string second = first.substr(0, first.size() - 7) + "2-x.png";
    std::filesystem::create_directory(folder.path() / second);
    const auto refused = (*kept)->add("x", bytes);
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().message(), HasSubstr(second));
    EXPECT_EQ(refused.error().cure, "check the folder's permissions and the disk") << "the disk is not full";
    auto archive = FrameArchive::open("/proc/hord-frames", {});
    ASSERT_FALSE(archive);
    EXPECT_THAT(archive.error().message(), HasSubstr("/proc/hord-frames"));
}

TEST(FrameArchive, on_a_disk_that_answers_with_errors_fails_and_does_not_throw) {
    const TempFolder folder;
    std::filesystem::create_symlink("loop", folder.path() / "loop");
    for (const char* name : {"loop", "loop/frames", "none/frames"})
        EXPECT_EQ(FrameArchive::open(folder.path() / name, {}).error().code, ErrorCode::io);
    const auto io_error = [](const std::filesystem::path&) { return std::make_error_code(std::errc::io_error); };
    ArchiveDisk disk = real_disk();
    disk.make_folder = io_error;
    EXPECT_THAT(FrameArchive::open(folder.path(), {}, disk).error().message(), HasSubstr("Input/output error"));
    disk = real_disk();
    disk.list = [](const std::filesystem::path&) -> Result<std::vector<ArchivedFile>> {
        return fail(ErrorCode::io, "the folder cannot be read (Input/output error)", "check the disk");
    };
    EXPECT_FALSE(FrameArchive::open(folder.path(), {}, disk));
    disk = real_disk();
    disk.remove = io_error;
    auto archive = FrameArchive::open(folder.path(), {.max_bytes = 1000, .min_free_bytes = 0}, disk);
    ASSERT_TRUE(archive);
    ASSERT_TRUE((*archive)->add("x", std::vector<std::uint8_t>(800)));
    EXPECT_THAT((*archive)->add("y", std::vector<std::uint8_t>(800)).error().message(), HasSubstr("cannot be removed"));
}

}  // namespace
}  // namespace hord::firmware::store::test
