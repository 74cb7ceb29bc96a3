// Retained frames: complete or recognised as torn, chosen by the rules of retention, in a ring that never fills the
// disk. A second inspection has bit-identical results.
#include "firmware/store/frames/frame_retention.h"

#include <atomic>
#include <cmath>
#include <future>
#include <random>
#include <stdexcept>
#include <thread>

#include <nlohmann/json.hpp>

#include "firmware/recipes/recipe_file.h"
#include "firmware/store/frames/frame_archive.h"
#include "firmware/store/frames/frame_png.h"
#include "firmware/store/frames/replay.h"
#include "firmware/store/frames/replay_run.h"
#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using Json = nlohmann::json;

constexpr algo::Extents kExtents{24, 24, 5, 5};

// Every lenslet holds a spot about a bin wide, with its own noise; in a bad part the spots of one patch are displaced.
Frame part_frame(std::uint32_t seed, bool bad, int bits = 8) {
    Frame frame(kExtents.width_px(), kExtents.height_px(), bits);
    std::mt19937 random(seed);
    const double brightest = 0.8 * ((1 << bits) - 1);
    for (int n = 0; n < kExtents.n; ++n) {
        for (int m = 0; m < kExtents.m; ++m) {
            const bool jumps = bad && std::abs(m - 12) <= 1 && std::abs(n - 11) <= 1 && (m + n) % 2 == 0;
            const double x = jumps ? 0.2 : 2.0 + 0.5 * m / kExtents.m, y = 2.0;
            for (int j = 0; j < kExtents.j; ++j) {
                for (int i = 0; i < kExtents.i; ++i) {
                    const double spot = brightest * std::exp(-((i - x) * (i - x) + (j - y) * (j - y)));
                    const double noise = static_cast<double>(random() % 1000) / 1000.0 * 0.01 * brightest;
                    frame.set(m * kExtents.i + i, n * kExtents.j + j, static_cast<std::uint32_t>(spot + noise));
                }
            }
        }
    }
    return frame;
}

// -- what is kept with a frame

TEST(FrameMetadata, has_the_bits_of_a_sample) {
    FrameMetadata metadata;
    metadata.bits = 12;
    metadata.grid = kExtents;
    EXPECT_EQ(Json::parse(metadata.to_json()).at("bits"), 12);
}

TEST(FrameMetadata, its_maps_are_those_that_the_inspection_made) {
    const std::vector<float> map(6, 1.5F);
    const std::vector<std::uint8_t> mask(6, 1);
    algo::Inspection inspection;
    inspection.gradient = inspection.frobenius = inspection.transmission = inspection.z_score = map;
    inspection.mask = mask;
    for (const bool compares : {true, false}) {
        inspection.compares = compares ? std::optional(algo::Feature::emd) : std::nullopt;
        EXPECT_EQ(bytes_of_maps(inspection).size(), 6 * ((compares ? 3 : 4) * sizeof(float) + 1)) << compares;
    }
}

// -- one frame as a file

TEST(FramePng, gives_back_every_bit_and_every_word) {
    for (const int bits : {8, 10, 12, 16}) {
        const Frame frame = part_frame(1, true, bits);
        const std::string text = "{\"recipe\":\"a \\\"b\\\"\\n µ\"}";
        const auto png = encode_png(frame.view(), text);
        ASSERT_TRUE(png) << png.error().message();
        const auto back = decode_png(*png, "f.png");
        ASSERT_TRUE(back) << back.error().message();
        EXPECT_EQ(back->frame.bits(), bits);
        EXPECT_TRUE(std::equal(frame.bytes().begin(), frame.bytes().end(), back->frame.bytes().begin(),
                               back->frame.bytes().end()));
        EXPECT_EQ(back->metadata, text);
    }
}

TEST(FramePng, recognises_every_cut_and_every_changed_byte) {
    const Frame frame = part_frame(1, true);
    const auto png = encode_png(frame.view(), "{}");
    ASSERT_TRUE(png);
    for (std::size_t length = 0; length < png->size(); length += 1 + length / 50) {
        EXPECT_FALSE(decode_png(std::span(*png).first(length), "f.png"))
            << "cut at " << length << " of " << png->size();
    }
    std::mt19937 random(7);
    for (int k = 0; k < 300; ++k) {
        auto changed = *png;
        changed[random() % changed.size()] ^= static_cast<std::uint8_t>(1U << (random() % 8));
        EXPECT_FALSE(decode_png(changed, "f.png")) << k;
    }
    auto longer = *png;
    longer.push_back(0);
    EXPECT_FALSE(decode_png(longer, "f.png"));
}

// -- the ring

std::vector<std::string> names(const std::filesystem::path& folder) {
    std::vector<std::string> all;
    const auto files = list_frames(folder);
    EXPECT_TRUE(files);
    for (const ArchivedFile& file : *files) all.push_back(file.file.filename().string());
    return all;
}

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
    write_text(folder.path() / "notes.txt", "mine");
    auto archive = FrameArchive::open(folder.path(), {});
    ASSERT_TRUE(archive);
    EXPECT_EQ((*archive)->next_number(), 8U);
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "000000000008-y.png.part"));
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

// -- choosing

// The drawn part fills the field.
algo::Recipe unchecked_part() {
    algo::Recipe recipe;
    recipe.part_required = false;
    return recipe;
}

// A keeper without a thread over a folder, and an inspection pipeline.
struct Cell {
    explicit Cell(FrameRetentionOptions options = {}, const ArchiveDisk& disk = real_disk(),
                  const algo::Recipe& recipe = unchecked_part(), algo::MapSet maps = algo::MapSet::judged,
                  int sample_bits = 8)
        : bits(sample_bits), pipeline(algo::Pipeline::create(kExtents, bits, recipe, 1, maps).value()),
          keeper(
              [this, disk] {
                  return FrameArchive::open(folder.path() / "frames", {.max_bytes = 100'000'000, .min_free_bytes = 0},
                                            disk);
              },
              complete(std::move(options)), [] { return kNoon; },
              {[this](const Error& e) { said.push_back(e.message()); }, [this] { said.emplace_back("works again"); }}) {
        keeper.set_recipe(format_recipe({.number = 3, .version = 1, .recipe = recipe}));
    }
    static FrameRetentionOptions complete(FrameRetentionOptions options) {
        options.extents = kExtents;
        options.station = "cell 3";
        options.software = "0.1.0";
        options.boot = 7;
        options.thread = false;
        return options;
    }
    void inspect(std::uint32_t part, bool bad) {
        const Frame frame = part_frame(part, bad, bits);
        const auto inspection = pipeline.inspect(frame.view());
        ASSERT_TRUE(inspection);
        ASSERT_EQ(inspection->verdict, bad ? algo::Verdict::reject : algo::Verdict::pass);
        keeper.on_inspection(part, frame.view(), *inspection);
    }
    void write_all() {
        while (keeper.step()) {
        }
    }
    // "p12-reject" ...
    std::vector<std::string> kept() {
        write_all();
        std::vector<std::string> all;
        if (!std::filesystem::exists(folder.path() / "frames")) return all;
        for (const std::string& name : names(folder.path() / "frames")) {
            const auto from = name.find("-p") + 1;
            all.push_back(name.substr(from, name.size() - from - 4));
        }
        return all;
    }
    TempFolder folder;
    std::vector<std::string> said;
    int bits;
    algo::Pipeline pipeline;
    FrameRetention keeper;
};

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
        {.extents = kExtents, .before = 0, .after = 0, .trim_every = std::chrono::milliseconds(1)},
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

// -- second inspection

TEST(FrameMetadata, of_before_two_reasons_were_renamed_is_read_with_the_present_names) {
    FrameMetadata data;
    data.grid = kExtents;
    data.role = "reject";
    data.judgement = {"reject", "slope", 1.5F, Json::array(), ""};
    EXPECT_EQ(FrameMetadata::from_json(data.to_json(), "frame").value().judgement.reason, "deflection-gradient");
    data.judgement.reason = "deflection";
    EXPECT_EQ(FrameMetadata::from_json(data.to_json(), "frame").value().judgement.reason, "neighbours-disagree");
}

TEST(Replay, with_the_recipe_of_then_is_the_same_to_the_bit) {
    Cell cell({.before = 3, .after = 3});
    for (std::uint32_t part = 1; part <= 20; ++part) cell.inspect(part, part % 6 == 0);
    cell.write_all();
    Replay replay;
    const auto files = list_frames(cell.folder.path() / "frames");
    ASSERT_GT(files->size(), 10U);
    for (const ArchivedFile& file : *files) {
        const auto replayed = replay.judge(file.file);
        ASSERT_TRUE(replayed) << replayed.error().message();
        EXPECT_TRUE(replayed->same()) << to_json_line(*replayed);
        EXPECT_THAT(to_json_line(*replayed), HasSubstr("\"changes\":[]"));
    }
}

// As frames were kept before gradients were bounded.
TEST(Replay, of_frames_with_exact_maps_is_the_same_to_the_bit) {
    Cell cell({.before = 1, .after = 1}, real_disk(), unchecked_part(), algo::MapSet::exact);
    for (std::uint32_t part = 1; part <= 6; ++part) cell.inspect(part, part % 3 == 0);
    cell.write_all();
    Replay replay;
    const auto files = list_frames(cell.folder.path() / "frames");
    ASSERT_GT(files->size(), 3U);
    for (const ArchivedFile& file : *files) {
        const auto metadata = read_annotated_frame(file.file).value().metadata;
        EXPECT_FALSE(Json::parse(metadata).contains("maps"));
        EXPECT_EQ(Json::parse(metadata).at("dark_dn"), algo::kDarkDn8Bit);
        const auto replayed = replay.judge(file.file);
        ASSERT_TRUE(replayed) << replayed.error().message();
        EXPECT_TRUE(replayed->same()) << to_json_line(*replayed);
    }
}

TEST(Replay, of_an_inspection_whose_time_ran_out_compares_verdict_and_reason_only) {
    Replayed r;
    r.then = {"reject", "neighbours-disagree", 2.5F, Json::array(), "one", true, true, true};
    r.now = {"reject", "neighbours-disagree", 2.25F, Json::array(), "other", true, true, false};
    EXPECT_TRUE(r.same());
    r.now.verdict = "pass";
    EXPECT_FALSE(r.same());
    r.now.verdict = "reject";
    r.then.out_of_time = false;
    EXPECT_FALSE(r.same());
}

TEST(Replay, with_another_recipe_shows_what_changes) {
    algo::Recipe strict = unchecked_part();
    strict.name = "strict";
    Cell cell({.before = 1, .after = 0}, real_disk(), strict);
    cell.inspect(1, false);
    cell.inspect(2, true);
    cell.write_all();
    algo::Recipe lenient = unchecked_part();
    lenient.name = "lenient";
    lenient.emd_limit_bins = lenient.frobenius_limit_bins = 30;
    lenient.transmission_limit = 0;
    Replay replay(lenient);
    const auto files = list_frames(cell.folder.path() / "frames");
    const auto good = replay.judge(files->at(0).file), bad = replay.judge(files->at(1).file);
    EXPECT_EQ(good->now.verdict, "pass");
    EXPECT_TRUE(bad->verdict_changes());
    EXPECT_EQ(bad->then.verdict, "reject");
    EXPECT_EQ(bad->now.verdict, "pass");
    EXPECT_EQ(bad->recipe_then, "strict");
    EXPECT_EQ(bad->recipe_now, "lenient");
    // Limits do not change the map, but where it is exact: maps are not compared then.
    EXPECT_TRUE(bad->then.maps_of_bounds);
    EXPECT_THAT(to_json_line(*bad), HasSubstr("\"changes\":[\"verdict\",\"reason\",\"score\",\"defects\"]"));
}

TEST(Replay, inspects_each_frame_with_its_own_recipe) {
    algo::Recipe strict = unchecked_part();
    strict.emd_limit_bins /= 2;
    strict.frobenius_limit_bins /= 2;
    Cell usual({.before = 0, .after = 0}), strictly({.before = 0, .after = 0}, real_disk(), strict);
    Replay replay;
    for (Cell* cell : {&usual, &strictly}) {
        cell->inspect(1, true);
        cell->write_all();
        const auto files = list_frames(cell->folder.path() / "frames");
        ASSERT_EQ(files->size(), 1U);
        const auto replayed = replay.judge(files->at(0).file);
        ASSERT_TRUE(replayed) << replayed.error().message();
        EXPECT_TRUE(replayed->same()) << to_json_line(*replayed);
    }
}

TEST(Replay, refuses_a_frame_whose_samples_somebody_exchanged) {
    Cell cell({.before = 0, .after = 0});
    cell.inspect(1, true);
    cell.write_all();
    const auto file = list_frames(cell.folder.path() / "frames")->at(0).file;
    const std::string metadata = read_annotated_frame(file)->metadata;
    const auto forged = encode_png(part_frame(1, false).view(), metadata);
    write_text(file, std::string(forged->begin(), forged->end()));
    const auto replayed = Replay().judge(file);
    ASSERT_FALSE(replayed);
    EXPECT_THAT(replayed.error().message(), HasSubstr("other samples"));
}

TEST(Replay, says_of_a_frame_whose_recipe_cannot_be_used_that_it_is_that) {
    for (const std::string& recipe : {std::string("limits = 7\n"), std::string("no recipe")}) {
        Cell cell({.before = 0, .after = 0});
        cell.keeper.set_recipe(recipe);
        cell.inspect(1, true);
        cell.write_all();
        const auto file = list_frames(cell.folder.path() / "frames")->at(0).file;
        const auto replayed = Replay().judge(file);
        ASSERT_FALSE(replayed);
        EXPECT_THAT(replayed.error().message(), HasSubstr(file.filename().string()));
        const auto given = Replay(unchecked_part()).judge(file);
        ASSERT_TRUE(given) << "with another recipe it can be judged";
        EXPECT_EQ(given->recipe_then, "");
    }
}

// 129 frames: one more than a block of two threads.
TEST(ReplayAll, gives_each_result_with_its_frame_in_order_on_any_number_of_threads_until_it_is_told_to_stop) {
    Cell cell({.before = 0, .after = 0});
    for (std::uint32_t part = 1; part <= 3; ++part) cell.inspect(part, true);
    cell.write_all();
    const auto kept = *list_frames(cell.folder.path() / "frames");
    ASSERT_THAT(kept, SizeIs(3));
    std::vector<ArchivedFile> frames, few;
    for (std::size_t k = 0; k < 129; ++k) frames.push_back(kept.at(k * k % 3));
    few.assign(frames.begin(), frames.begin() + 3);
    for (const unsigned jobs : {0U, 1U, 2U, 5U}) {
        for (const std::size_t most : {std::size_t{1}, std::size_t{2}, std::size_t{128}, std::size_t{1000}}) {
            const auto& all = jobs == 2 && most > 2 ? frames : few;
            std::size_t taken = 0;
            replay_all(all, std::nullopt, jobs, [&](const ArchivedFile& frame, const Result<Replayed>& replayed) {
                EXPECT_EQ(frame.number, all.at(taken).number);
                EXPECT_TRUE(replayed && replayed->part == frame.number && replayed->same());
                return ++taken < most;
            });
            EXPECT_EQ(taken, std::min(most, all.size())) << jobs;
        }
    }
}

TEST(ReplayAll, inspects_every_frame_with_the_recipe_that_it_is_given) {
    Cell cell({.before = 0, .after = 0});
    cell.inspect(1, true);
    cell.write_all();
    algo::Recipe lenient = unchecked_part();
    lenient.emd_limit_bins = 100;
    lenient.slopes = lenient.light = false;
    for (const unsigned jobs : {1U, 2U}) {
        replay_all(*list_frames(cell.folder.path() / "frames"), lenient, jobs,
                   [&](const ArchivedFile&, const Result<Replayed>& replayed) {
                       EXPECT_TRUE(replayed && replayed->then.verdict == "reject" && replayed->now.verdict == "pass");
                       return true;
                   });
    }
}

TEST(ReplayOrder, is_that_of_the_names_as_they_are_written_and_no_name_is_there_twice) {
    std::vector<ArchivedFile> frames{{3, "b/x.png", 1}, {1, "c/a\"q.png", 2}, {2, "a/y.png", 3}, {4, "z/a.png", 4}};
    ASSERT_TRUE(put_in_order(frames));
    std::vector<std::string> names;
    for (const ArchivedFile& frame : frames) names.push_back(std::to_string(frame.number) + written_name(frame));
    EXPECT_THAT(names, ElementsAre("4a.png", "1a\\\"q.png", "3x.png", "2y.png"));
    frames.push_back({5, "another/y.png", 3});
    EXPECT_THAT(put_in_order(frames).error().message(), HasSubstr("two frames are called y.png"));
    frames.clear();
    EXPECT_TRUE(put_in_order(frames));
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
