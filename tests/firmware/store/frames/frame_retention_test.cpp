// Which frames are retained, by the rules of retention, and what is said when the disk does not take them.

#include "firmware/store/frames/frame_retention.h"

#include <atomic>
#include <future>
#include <limits>
#include <stdexcept>

#include <nlohmann/json.hpp>

#include "firmware/recipes/recipe_file.h"
#include "firmware/store/frames/frame_archive.h"
#include "firmware/store/frames/frame_png.h"
#include "firmware/store/frames/replay.h"
#include "tests/firmware/store/frames/retained_parts.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using Json = nlohmann::json;

TEST(FrameRetention, keeps_rejects_and_the_parts_around_them) {
    Cell cell({.before = 2, .after = 1});
    for (std::uint32_t part = 1; part <= 12; ++part) cell.inspect(part, part == 5 || part == 10);
    EXPECT_THAT(cell.kept(),
                ElementsAre("p3-before", "p4-before", "p5-reject", "p6-after", "p8-before", "p9-before", "p10-reject",
                            "p11-after"));
    EXPECT_EQ(cell.keeper.counts().kept, 8U);
    EXPECT_EQ(cell.keeper.counts().dropped, 0U);
}

TEST(FrameRetention, names_a_file_by_its_number_its_time_its_part_and_why) {
    Cell cell({.before = 1, .after = 0});
    cell.inspect(8, false);
    cell.inspect(9, true);
    cell.write_all();
    EXPECT_THAT(
        names(cell.folder.path() / "frames"),
        ElementsAre("000000000001-20260921T141320Z-p8-before.png", "000000000002-20260921T141320Z-p9-reject.png"));
}

TEST(FrameRetention, takes_the_oldest_that_passed_when_it_has_no_other_buffer) {
    Cell cell({.before = 9, .after = 0, .buffers = 3});
    for (std::uint32_t part = 1; part <= 6; ++part) cell.inspect(part, part == 6);
    EXPECT_THAT(cell.kept(), ElementsAre("p4-before", "p5-before", "p6-reject"));
    EXPECT_EQ(cell.keeper.counts().dropped, 0U) << "nothing that was wanted";
}

TEST(FrameRetention, does_nothing_in_a_step_without_a_frame) {
    Cell cell;
    EXPECT_FALSE(cell.keeper.step());
    cell.inspect(1, false);
    EXPECT_FALSE(cell.keeper.step()) << "it may be needed, and is not kept yet";
    cell.inspect(2, true);
    EXPECT_TRUE(cell.keeper.step());
    EXPECT_TRUE(cell.keeper.step());
    EXPECT_FALSE(cell.keeper.step());
    EXPECT_EQ(cell.keeper.finish(), 0U);
}

// A late verdict takes its part from among those that passed; the earlier ones are before it, the later ones stay.
TEST(FrameRetention, finds_a_late_part_between_others) {
    Cell cell({.before = 1, .after = 1});
    for (std::uint32_t part = 1; part <= 5; ++part) cell.inspect(part, false);
    PartResult late;
    late.part = 3;
    late.verdict = PartVerdict::reject;
    late.reason = PartReason::verdict_late;
    cell.keeper.on_result(late);
    cell.inspect(6, false);
    cell.inspect(7, true);
    EXPECT_THAT(cell.kept(), ElementsAre("p2-before", "p3-reject", "p6-after", "p5-before", "p7-reject"));
    late.part = 99;
    late.verdict = PartVerdict::pass;
    cell.keeper.on_result(late);
    cell.inspect(98, false);
    cell.inspect(99, false);
    cell.inspect(100, false);
    EXPECT_THAT(cell.kept(), SizeIs(6)) << "98 is after 7, and 99 passed";
}

TEST(FrameRetention, keeps_a_part_around_two_rejects_once) {
    Cell cell({.before = 2, .after = 2});
    for (std::uint32_t part = 1; part <= 8; ++part) cell.inspect(part, part == 3 || part == 5);
    EXPECT_THAT(cell.kept(),
                ElementsAre("p1-before", "p2-before", "p3-reject", "p4-after", "p5-reject", "p6-after", "p7-after"));
}

TEST(FrameRetention, keeps_every_so_many_as_a_sample) {
    Cell cell({.before = 0, .after = 0, .sample_every = 4});
    for (std::uint32_t part = 1; part <= 9; ++part) cell.inspect(part, part == 6);
    EXPECT_THAT(cell.kept(), ElementsAre("p4-sample", "p6-reject", "p8-sample"));
}

TEST(FrameRetention, keeps_a_good_part_that_was_rejected_because_its_verdict_came_late) {
    for (const bool result_first : {false, true}) {
        Cell cell({.before = 1, .after = 0});
        PartResult late;
        late.part = 3;
        late.verdict = PartVerdict::unfit;
        late.reason = PartReason::verdict_late;
        cell.inspect(1, false);
        cell.inspect(2, false);
        if (result_first) cell.keeper.on_result(late);
        cell.inspect(3, false);
        if (!result_first) cell.keeper.on_result(late);
        cell.inspect(4, false);
        EXPECT_THAT(cell.kept(), ElementsAre("p2-before", "p3-reject"));
    }
}

TEST(FrameRetention, drops_counts_and_says_so_when_the_disk_is_too_slow_and_recovers) {
    Cell cell({.before = 0, .after = 0, .buffers = 3});
    for (std::uint32_t part = 1; part <= 5; ++part) cell.inspect(part, true);  // no frame is written meanwhile
    EXPECT_EQ(cell.keeper.counts().dropped, 2U);
    EXPECT_TRUE(cell.keeper.counts().failing);
    ASSERT_THAT(cell.said, SizeIs(1));
    EXPECT_THAT(cell.said[0], HasSubstr("faster"));
    EXPECT_THAT(cell.kept(), ElementsAre("p1-reject", "p2-reject", "p3-reject"));
    EXPECT_FALSE(cell.keeper.counts().failing);
    EXPECT_EQ(cell.said.back(), "works again");
}

TEST(FrameRetention, goes_on_when_a_full_disk_has_room_again) {
    ArchiveDisk disk = real_disk();
    bool is_full = true;
    disk.write = [&, real = disk.write](const std::filesystem::path& file,
                                        std::span<const std::uint8_t> bytes) -> Result<void> {
        if (is_full)
            return fail(ErrorCode::io, file.string() + " cannot be written (No space left on device)", "free space");
        return real(file, bytes);
    };
    Cell cell({.before = 0, .after = 0}, disk);
    cell.inspect(1, true);
    cell.inspect(2, true);
    EXPECT_THAT(cell.kept(), IsEmpty());
    EXPECT_EQ(cell.keeper.counts().dropped, 2U);
    ASSERT_THAT(cell.said, SizeIs(1));
    is_full = false;
    cell.inspect(3, true);
    EXPECT_THAT(cell.kept(), ElementsAre("p3-reject"));
    EXPECT_EQ(cell.said.back(), "works again");
    EXPECT_EQ(cell.keeper.finish(), 0U);
}

TEST(FrameRetention, counts_at_its_end_what_a_disk_that_still_fails_did_not_take) {
    ArchiveDisk disk = real_disk();
    disk.write = [](const std::filesystem::path& file, std::span<const std::uint8_t>) -> Result<void> {
        return fail(ErrorCode::io, file.string() + " cannot be written (No space left on device)", "free space");
    };
    Cell cell({.before = 0, .after = 0}, disk);
    cell.inspect(1, true);
    cell.inspect(2, true);
    EXPECT_THAT(cell.kept(), IsEmpty());
    EXPECT_EQ(cell.keeper.finish(), 2U);
}

// A keeper with its thread over a disk that takes files of at most `largest` bytes, and one reject that it had to drop.
struct DroppedReject {
    explicit DroppedReject(std::chrono::milliseconds look_every)
        : keeper(
              [this] {
                  return FrameArchive::open(folder.path(), {.max_bytes = 100'000'000, .min_free_bytes = 0},
                                            limited_disk());
              },
              {.extents = kExtents, .before = 0, .after = 0, .look_every = look_every}, [] { return kNoon; },
              {[this](const Error&) { ++failures; }, [this] { ++recoveries; }}) {
        keeper.set_recipe(format_recipe({.number = 3, .version = 1, .recipe = unchecked_part()}));
        auto pipeline = algo::Pipeline::create(kExtents, 8, unchecked_part(), 1).value();
        const Frame frame = part_frame(1, true);
        keeper.on_inspection(1, frame.view(), pipeline.inspect(frame.view()).value());
        EXPECT_TRUE(wait_for([this] { return keeper.counts().failing; }));
    }
    ArchiveDisk limited_disk() {
        ArchiveDisk disk = real_disk();
        disk.write = [this, real = disk.write](const std::filesystem::path& file,
                                               std::span<const std::uint8_t> bytes) -> Result<void> {
            ++tries;
            if (bytes.size() > largest) return fail(ErrorCode::io, file.string() + " cannot be written", "free space");
            return real(file, bytes);
        };
        return disk;
    }
    static bool wait_for(const std::function<bool()>& what) {
        const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
        while (!what() && std::chrono::steady_clock::now() < until)
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        return what();
    }
    static constexpr std::size_t kAnySize = std::numeric_limits<std::size_t>::max();

    const TempFolder folder;
    std::atomic<std::size_t> largest = 0;
    std::atomic<int> tries = 0, failures = 0, recoveries = 0;
    FrameRetention keeper;
};

TEST(FrameRetention, notices_a_disk_that_was_freed_while_no_frame_came) {
    DroppedReject dropped(std::chrono::milliseconds(1));
    dropped.largest = DroppedReject::kAnySize;
    EXPECT_TRUE(DroppedReject::wait_for([&] { return dropped.recoveries == 1; }));
    EXPECT_EQ(dropped.keeper.finish(), 0U);
    EXPECT_EQ(dropped.keeper.counts().dropped, 1U);
    EXPECT_EQ(dropped.failures, 1);
    EXPECT_EQ(dropped.recoveries, 1);
    EXPECT_TRUE(std::filesystem::is_empty(dropped.folder.path()));
}

TEST(FrameRetention, looks_at_the_disk_once_more_at_its_end) {
    DroppedReject dropped(std::chrono::hours(1));
    dropped.largest = DroppedReject::kAnySize;
    EXPECT_EQ(dropped.keeper.finish(), 0U);
    EXPECT_EQ(dropped.recoveries, 1);
    EXPECT_TRUE(std::filesystem::is_empty(dropped.folder.path()));
}

TEST(FrameRetention, asks_the_disk_for_room_as_large_as_the_frame_that_was_dropped) {
    DroppedReject dropped(std::chrono::milliseconds(1));
    dropped.largest = 1000;  // less than a frame
    const int before = dropped.tries;
    EXPECT_TRUE(DroppedReject::wait_for([&] { return dropped.tries >= before + 2; }));
    EXPECT_EQ(dropped.keeper.finish(), 1U);
    EXPECT_EQ(dropped.recoveries, 0);
    EXPECT_EQ(dropped.failures, 1) << "told once";
}

TEST(FrameRetention, makes_room_for_results_before_it_writes_another_frame) {
    static constexpr std::uint64_t kDisk = 2'000'000;
    std::uint64_t others = 0;
    ArchiveDisk disk = real_disk();
    disk.free_bytes = [&](const std::filesystem::path& folder) -> Result<std::uint64_t> {
        const auto files = list_frames(folder);
        std::uint64_t used = others;
        for (const ArchivedFile& file : *files) used += file.bytes;
        return kDisk - std::min(kDisk, used);
    };
    Cell cell({.before = 0, .after = 0}, disk);
    for (const std::uint32_t part : {1U, 2U, 3U}) cell.inspect(part, true);
    EXPECT_THAT(cell.kept(), SizeIs(3));
    others = kDisk - FrameRetention::kRoomForResults;  // the disk is full but for what the results take now
    cell.inspect(4, true);
    cell.keeper.make_room_for_results();
    EXPECT_THAT(cell.kept(), IsEmpty());
    EXPECT_EQ(cell.keeper.counts().dropped, 1U);
    EXPECT_THAT(cell.said, ElementsAre(HasSubstr("stay free")));
    others = 0;
    cell.inspect(5, true);
    EXPECT_THAT(cell.kept(), ElementsAre("p5-reject"));
    EXPECT_EQ(cell.said.back(), "works again");
}

TEST(FrameRetention, takes_an_exception_of_the_archive_for_a_failure) {
    ArchiveDisk disk = real_disk();
    bool throws = true;
    disk.make_folder = [&, real = disk.make_folder](const std::filesystem::path& folder) {
        if (throws) throw std::runtime_error("status: Input/output error");
        return real(folder);
    };
    Cell cell({.before = 0, .after = 0}, disk);
    cell.inspect(1, true);
    EXPECT_THAT(cell.kept(), IsEmpty());
    EXPECT_THAT(cell.said, ElementsAre(HasSubstr("Input/output error")));
    throws = false;
    cell.inspect(2, true);
    EXPECT_THAT(cell.kept(), ElementsAre("p2-reject"));
}

TEST(FrameRetention, makes_room_for_other_programs_without_a_frame) {
    const TempFolder folder;
    std::atomic<std::uint64_t> free_bytes{1'000'000'000};
    ArchiveDisk disk = real_disk();
    disk.free_bytes = [&](const std::filesystem::path&) -> Result<std::uint64_t> { return free_bytes.load(); };
    FrameRetention keeper(
        [&] { return FrameArchive::open(folder.path(), {.max_bytes = 100'000'000, .min_free_bytes = 1000}, disk); },
        {.extents = kExtents, .before = 0, .after = 0, .look_every = std::chrono::milliseconds(1)},
        [] { return kNoon; });
    keeper.set_recipe(format_recipe({.number = 3, .version = 1, .recipe = unchecked_part()}));
    auto pipeline = algo::Pipeline::create(kExtents, 8, unchecked_part(), 1).value();
    const Frame frame = part_frame(1, true);
    keeper.on_inspection(1, frame.view(), pipeline.inspect(frame.view()).value());
    const auto wait_for = [&](std::size_t count) {
        const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
        while (names(folder.path()).size() != count && std::chrono::steady_clock::now() < until)
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        return names(folder.path()).size() == count;
    };
    ASSERT_TRUE(wait_for(1));
    free_bytes = 0;
    EXPECT_TRUE(wait_for(0));
}

TEST(FrameRetention, has_written_what_waited_when_it_is_finished) {
    const TempFolder folder;
    std::promise<void> opens;
    const auto opened = opens.get_future().share();
    FrameRetention keeper(
        [&] {
            opened.wait();
            return FrameArchive::open(folder.path(), {.max_bytes = 100'000'000, .min_free_bytes = 0});
        },
        {.extents = kExtents, .before = 0, .after = 0}, [] { return kNoon; });
    keeper.set_recipe(format_recipe({.number = 3, .version = 1, .recipe = unchecked_part()}));
    auto pipeline = algo::Pipeline::create(kExtents, 8, unchecked_part(), 1).value();
    for (std::uint32_t part = 1; part <= 8; ++part) {
        const Frame frame = part_frame(part, true);
        keeper.on_inspection(part, frame.view(), pipeline.inspect(frame.view()).value());
    }
    opens.set_value();
    EXPECT_EQ(keeper.finish(), 0U);
    EXPECT_EQ(keeper.counts().kept, 8U);
    EXPECT_THAT(names(folder.path()), SizeIs(8));
}

TEST(FrameRetention, keeps_frames_of_twelve_bits_as_such) {
    Cell cell({.before = 0, .after = 0}, real_disk(), unchecked_part(), algo::MapSet::judged, 12);
    cell.inspect(1, true);
    cell.write_all();
    const auto files = list_frames(cell.folder.path() / "frames");
    ASSERT_EQ(files->size(), 1U);
    EXPECT_EQ(Json::parse(read_annotated_frame(files->at(0).file).value().metadata)["bits"], 12);
    const auto replayed = Replay().judge(files->at(0).file);
    ASSERT_TRUE(replayed) << replayed.error().message();
    EXPECT_TRUE(replayed->same()) << to_json_line(*replayed);
}

TEST(FrameRetention, writes_everything_that_replay_and_people_need) {
    Cell cell({.before = 1, .after = 0});
    cell.inspect(1, false);
    cell.inspect(2, true);
    cell.write_all();
    const auto files = list_frames(cell.folder.path() / "frames");
    ASSERT_EQ(files->size(), 2U);
    const Json before = Json::parse(read_annotated_frame(files->at(0).file).value().metadata);
    EXPECT_EQ(before["role"], "before");
    EXPECT_EQ(before["trigger"], 2);
    EXPECT_EQ(FrameMetadata::from_json(before.dump(), "frame").value().trigger, 2U);
    const Json json = Json::parse(read_annotated_frame(files->at(1).file).value().metadata);
    EXPECT_EQ(json["station"], "cell 3");
    EXPECT_EQ(json["boot"], 7);
    EXPECT_EQ(json["verdict"], "reject");
    EXPECT_EQ(json["grid"], Json({{"m", 24}, {"n", 24}, {"i", 5}, {"j", 5}}));
    EXPECT_FALSE(json["defects"].empty());
    EXPECT_THAT(json["recipe"].get<std::string>(), HasSubstr("emd_bins"));
}
TEST(FrameRetention, keeps_how_an_inspection_ended) {
    for (int ended = 0; ended < 3; ++ended) {
        Cell cell({.before = 0, .after = 0});
        const Frame frame = part_frame(1, true);
        algo::Inspection inspection = *cell.pipeline.inspect(frame.view());
        inspection.bounded = ended == 0;
        inspection.out_of_time = ended == 1;
        inspection.has_bounds = ended == 2;
        inspection.dark_dn = 17;
        cell.keeper.on_inspection(1, frame.view(), inspection);
        cell.write_all();
        const auto files = list_frames(cell.folder.path() / "frames");
        ASSERT_THAT(*files, SizeIs(1));
        const auto read = FrameMetadata::from_json(read_annotated_frame(files->at(0).file)->metadata, "frame");
        ASSERT_TRUE(read);
        EXPECT_EQ(read->judgement.bounded, ended == 0);
        EXPECT_EQ(read->judgement.out_of_time, ended == 1);
        EXPECT_EQ(read->judgement.maps_of_bounds, ended == 2);
        EXPECT_EQ(read->judgement.score, inspection.score);
        EXPECT_EQ(read->dark_dn, std::optional(17U));
        EXPECT_EQ(read->part, 1U);
        EXPECT_EQ(read->time_us, kNoon);
        EXPECT_EQ(read->grid, kExtents);
        EXPECT_EQ(read->bits, 8);
        EXPECT_EQ(read->judgement.defects.size(), inspection.defects.size());
    }
}

// Parts whose verdict came too late are expected, at most 64 of them; others that were rejected without an inspection
// are not.
// One buffer: its memory is used again.
TEST(FrameRetention, keeps_frames_of_any_size_one_after_the_other) {
    const TempFolder folder;
    FrameRetention keeper(
        [&] { return FrameArchive::open(folder.path(), {.max_bytes = 1'000'000, .min_free_bytes = 0}); },
        {.extents = kExtents, .before = 0, .after = 0, .buffers = 1, .thread = false}, [] { return kNoon; });
    keeper.set_recipe("x");
    algo::Inspection inspection;
    inspection.verdict = algo::Verdict::reject;
    std::uint32_t part = 0;
    for (const auto& [width, height, bits] : {std::tuple(9, 9, 8), {9, 12, 8}, {12, 12, 8}, {12, 12, 12}, {9, 9, 8}}) {
        Frame frame(width, height, bits);
        frame.set(width - 1, height - 1, 77);
        keeper.on_inspection(++part, frame.view(), inspection);
        ASSERT_TRUE(keeper.step());
        const auto files = *list_frames(folder.path());
        ASSERT_THAT(files, SizeIs(part));
        const auto kept = read_annotated_frame(files.back().file);
        ASSERT_TRUE(kept) << kept.error().message();
        EXPECT_EQ(kept->frame.view().width_px, width);
        EXPECT_EQ(kept->frame.view().height_px, height);
        EXPECT_EQ(kept->frame.view().bits, bits);
        EXPECT_EQ(kept->frame.view().sample(width - 1, height - 1), 77U);
    }
}

TEST(FrameRetention, remembers_so_many_late_parts_and_only_late_ones) {
    Cell cell({.before = 0, .after = 0});
    PartResult result;
    result.verdict = PartVerdict::unfit;
    for (std::uint32_t part = 1; part <= 65; ++part) {
        result.part = part;
        result.reason = PartReason::verdict_late;
        cell.keeper.on_result(result);
    }
    result.part = 70;
    result.reason = PartReason::frame_lost;
    cell.keeper.on_result(result);
    for (const std::uint32_t part : {1U, 2U, 65U, 65U, 70U}) cell.inspect(part, false);
    EXPECT_THAT(cell.kept(), ElementsAre("p2-reject", "p65-reject"));
}

}  // namespace
}  // namespace hord::firmware::store::test
