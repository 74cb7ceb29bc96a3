// The store of a configuration: its folder, its faults, which frames it keeps, and room on a small disk.
#include "firmware/store/recorder/store_setup.h"

#include <cstdlib>
#include <random>
#include <thread>

#include <sched.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/core/faults.h"
#include "firmware/store/frames/frame_archive.h"
#include "firmware/store/frames/frame_metadata.h"
#include "firmware/store/frames/frame_png.h"
#include "firmware/store/recorder/station_recorder.h"
#include "lab/virtual_time/virtual_time.h"
#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

TEST(FrameBuffers, are_as_many_as_fit_into_the_memory_for_them) {
    StoreConfig config;
    config.frames_before = 1;
    config.frame_buffers = 100;
    const algo::Extents extents{200, 100, 20, 40};  // 16 MB at 8 bits
    EXPECT_EQ(frame_buffers(config, extents, 8), 16U);
    EXPECT_EQ(frame_buffers(config, extents, 9), 8U);
    config.frame_buffers = 7;
    EXPECT_EQ(frame_buffers(config, extents, 8), 7U);
    config.frames_before = 30;
    config.frame_buffers = 100;
    EXPECT_EQ(frame_buffers(config, extents, 8), 32U) << "those that a rejected part needs";
}

TEST(StoreDisk, is_the_one_with_the_results_whatever_the_state_folder_is) {
    const TempFolder folder;
    const auto share_of = [](const std::filesystem::path& where) {
        const auto space = std::filesystem::space(where);
        return 100.0 * static_cast<double>(space.available) / static_cast<double>(space.capacity);
    };
    Config config;
    EXPECT_FALSE(store_disk_free_percent(config)) << "nothing is stored";
    config.store.folder = folder.path();
    ASSERT_TRUE(store_disk_free_percent(config)) << "without a state folder";
    EXPECT_NEAR(*store_disk_free_percent(config), share_of(folder.path()), 1);
    config.state_folder = "/proc";  // another file system
    EXPECT_NEAR(store_disk_free_percent(config).value_or(-1), share_of(folder.path()), 1);
    config.store.folder = folder.path() / "gone";
    EXPECT_FALSE(store_disk_free_percent(config));
    config.store.folder.clear();
    config.state_folder = folder.path();
    EXPECT_FALSE(store_disk_free_percent(config)) << "the store's folder is made at the start";
    std::filesystem::create_directory(folder.path() / "store");
    EXPECT_NEAR(store_disk_free_percent(config).value_or(-1), share_of(folder.path()), 1);
    config.store.enabled = false;
    EXPECT_FALSE(store_disk_free_percent(config));
}

TEST(StoreSetup, the_folder_is_the_configured_one_or_in_the_state_folder) {
    Config config;
    EXPECT_EQ(store_folder(config), "");
    config.state_folder = "/var/lib/hord";
    EXPECT_EQ(store_folder(config), "/var/lib/hord/store");
    config.store.folder = "/data/store";
    EXPECT_EQ(store_folder(config), "/data/store");
    config.store.enabled = false;
    EXPECT_EQ(store_folder(config), "");
    lab::VirtualTime loop;
    EXPECT_EQ(make_recorder(loop, config, {}, {}), nullptr);
}

Recorded recorded_with(const std::string& recipe) {
    Recorded recorded;
    recorded.software = "1.2";
    recorded.boot = 11;
    recorded.recipe_name = "lens";
    recorded.recipe = recipe;
    return recorded;
}

TEST(StoreSetup, a_folder_that_cannot_be_used_is_a_fault_and_nothing_is_lost_when_it_can_be_again) {
    const TempFolder folder;
    lab::VirtualTime loop;
    Config config;
    config.store.folder = folder.path() / "store";
    config.store.frames_mb = 0;
    write_text(config.store.folder, "a file is in the way");
    std::vector<std::string> troubles;
    std::uint32_t faults = 0;
    const auto recorder = make_recorder(
        loop, config, recorded_with("its text"),
        {[&](const Error& error) { troubles.push_back(error.what); }, [&](std::uint32_t now) { faults = now; }});
    ASSERT_NE(recorder, nullptr);
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (faults == 0 && std::chrono::steady_clock::now() < until) {
        if (!loop.run_one()) std::this_thread::yield();
    }
    EXPECT_EQ(faults, std::uint32_t{kFaultStore});
    EXPECT_THAT(troubles, ElementsAre(HasSubstr(config.store.folder.string())));
    std::filesystem::remove(config.store.folder);
    EXPECT_THAT(recorder->finish(), IsEmpty());
    while (loop.run_one()) {
    }
    EXPECT_EQ(faults, 0U);
}

// An own file system of 3 MB on `folder`, for this process alone. False: it may not mount one.
bool mount_small_disk(const std::filesystem::path& folder) {
    const bool apart = ::unshare(CLONE_NEWNS) == 0 || ::unshare(CLONE_NEWUSER | CLONE_NEWNS) == 0;
    return apart && ::mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0 &&
        ::mount("small", folder.c_str(), "tmpfs", 0, "size=3m") == 0;
}

// Frames fill the disk, then results come. Ends the process: 0 all results are stored, 1 not, 2 no disk.
[[noreturn]] void store_beside_frames(const std::filesystem::path& folder) {
    if (!mount_small_disk(folder)) std::_Exit(2);
    const auto wait_until = [](const auto& holds) {
        const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
        while (!holds() && std::chrono::steady_clock::now() < until)
            std::this_thread::sleep_for(std::chrono::milliseconds(2));
        return holds();
    };
    lab::VirtualTime loop;
    Config config;
    config.store.folder = folder / "store";
    config.store.free_mb = 0;
    config.store.frames_mb = 100;
    Recorded recorded = recorded_with("its text");
    recorded.extents = {40, 40, 9, 9};
    const auto recorder = make_recorder(loop, config, recorded, {});
    PartResult result;
    const auto store = [&](std::uint32_t up_to) {
        while (result.sequence < up_to) {
            result.part = ++result.sequence;
            recorder->on_result(result);
        }
        (void)recorder->on_acknowledged({"plc", 0}, up_to);  // has it written at once
        return wait_until([&] { return recorder->state().durable_sequence == up_to; });
    };
    bool good = store(10);
    const auto left = [&] { return std::filesystem::space(folder).available; };
    Frame frame(360, 360, 8);
    std::mt19937 random(1);
    for (std::byte& sample : frame.bytes()) sample = std::byte{static_cast<std::uint8_t>(random())};
    algo::Inspection inspection;
    inspection.verdict = algo::Verdict::reject;
    for (std::uint32_t part = 1; part <= 40; ++part) {
        recorder->on_inspection(part, frame.view(), inspection);
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    good = good && wait_until([&] { return left() < 150'000; });
    good = good && store(6000);
    // One batch each: the log grows by some pages with every one.
    for (std::uint32_t more = 1; good && more <= 400; ++more) good = store(6000 + more);
    good = good && recorder->finish().empty() && recorder->state().lost == 0;
    std::error_code none;
    good = good && !std::filesystem::is_empty(config.store.folder / "frames", none);
    std::_Exit(good ? 0 : 1);
}

TEST(StoreSetup, frames_that_fill_the_disk_make_room_for_results) {
    const TempFolder folder;
    const pid_t child = ::fork();
    ASSERT_GE(child, 0);
    if (child == 0) store_beside_frames(folder.path());
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFEXITED(status));
    if (WEXITSTATUS(status) == 2) GTEST_SKIP() << "this user may not mount a file system";
    EXPECT_EQ(WEXITSTATUS(status), 0);
}

TEST(StoreSetup, the_recipe_and_the_configuration_in_use_are_recorded) {
    const TempFolder folder;
    lab::VirtualTime loop;
    Config config;
    config.file = folder.path() / "hordd.toml";
    write_text(config.file, "# as it was read\n");
    config.store.folder = folder.path();
    config.store.frames_mb = 0;
    config.name = "cell 9";
    const auto recorder = make_recorder(loop, config, recorded_with("its text"), {});
    PartResult result;
    result.sequence = 1;
    recorder->on_result(result);
    EXPECT_THAT(recorder->finish(), IsEmpty());
    std::vector<std::string> told;
    for (const StoredChange& c : changes(folder)) told.push_back(c.what + " " + c.after);
    EXPECT_THAT(told,
                ::testing::UnorderedElementsAre(R"(start {"boot":11,"software":"1.2"})",
                                                "configuration # as it was read\n", "recipe its text"));
    EXPECT_EQ(changes(folder).at(0).name, "cell 9");
    EXPECT_EQ(results(folder).at(0).software, "1.2");
}

Recorded recorded_frames(const std::string& recipe) {
    Recorded recorded = recorded_with(recipe);
    recorded.extents = {3, 3, 3, 3};
    return recorded;
}

void inspected(StationRecorder& recorder, std::uint32_t part, algo::Verdict verdict) {
    static const Frame frame(9, 9, 8);
    algo::Inspection inspection;
    inspection.verdict = verdict;
    recorder.on_inspection(part, frame.view(), inspection);
}

TEST(StoreSetup, frames_are_kept_as_the_configuration_wants_it) {
    const TempFolder folder;
    lab::VirtualTime loop;
    Config config;
    config.name = "cell 9";
    config.store.folder = folder.path() / "store";
    config.store.frames_mb = 1;
    config.store.free_mb = 0;
    config.store.frames_before = 1;
    config.store.frames_after = 2;
    config.store.sample_every = 10;
    const auto recorder = make_recorder(loop, config, recorded_frames("its text"), {});
    for (std::uint32_t part = 1; part <= 10; ++part)
        inspected(*recorder, part, part == 3 ? algo::Verdict::reject : algo::Verdict::pass);
    EXPECT_THAT(recorder->finish(), IsEmpty());
    std::vector<std::string> kept;
    const auto files = *list_frames(config.store.folder / kFramesFolder);
    for (const ArchivedFile& file : files) {
        const auto read = FrameMetadata::from_json(read_annotated_frame(file.file)->metadata, "frame");
        ASSERT_TRUE(read);
        kept.push_back(std::to_string(read->part) + " " + read->role + " of " + std::to_string(read->trigger));
        EXPECT_EQ(read->station + read->software + read->recipe, "cell 91.2its text");
        EXPECT_EQ(read->boot, 11U);
        EXPECT_EQ(read->grid, (algo::Extents{3, 3, 3, 3}));
    }
    EXPECT_THAT(kept, ElementsAre("2 before of 3", "3 reject of 3", "4 after of 3", "5 after of 3", "10 sample of 0"));
}

TEST(StoreSetup, the_frame_of_a_part_whose_verdict_came_too_late_is_kept) {
    const TempFolder folder;
    lab::VirtualTime loop;
    Config config;
    config.store.folder = folder.path();
    config.store.free_mb = 0;
    config.store.frames_before = config.store.frames_after = 0;
    const auto recorder = make_recorder(loop, config, recorded_frames("x"), {});
    for (const std::uint32_t part : {1U, 2U}) inspected(*recorder, part, algo::Verdict::pass);
    PartResult late;
    late.part = 2;
    late.verdict = PartVerdict::unfit;
    late.reason = PartReason::verdict_late;
    recorder->on_result(late);
    EXPECT_THAT(recorder->finish(), IsEmpty());
    const auto files = *list_frames(folder.path() / kFramesFolder);
    ASSERT_THAT(files, SizeIs(1));
    EXPECT_THAT(files[0].file.filename().string(), ::testing::EndsWith("-p2-reject.png"));
}

TEST(StoreSetup, a_frame_has_the_recipe_that_was_in_use) {
    const TempFolder folder;
    lab::VirtualTime loop;
    Config config;
    config.store.folder = folder.path();
    config.store.free_mb = 0;
    const auto recorder = make_recorder(loop, config, recorded_frames("first"), {});
    inspected(*recorder, 1, algo::Verdict::reject);
    recorder->on_change({Change::What::recipe, {}, "lens", "first", "second"});
    inspected(*recorder, 2, algo::Verdict::reject);
    recorder->on_change({Change::What::configuration, {}, "hordd.toml", "a", "b"});
    recorder->on_change({Change::What::command, {}, "arm", "a", "b"});
    inspected(*recorder, 3, algo::Verdict::reject);
    recorder->in_use(ChangeRecord::What::configuration, "hordd.toml", "b");
    inspected(*recorder, 4, algo::Verdict::reject);
    EXPECT_THAT(recorder->finish(), IsEmpty());
    std::vector<std::string> recipes;
    const auto files = *list_frames(folder.path() / kFramesFolder);
    for (const ArchivedFile& file : files)
        recipes.push_back(FrameMetadata::from_json(read_annotated_frame(file.file)->metadata, "frame")->recipe);
    EXPECT_THAT(recipes, ElementsAre("first", "second", "second", "second"));
}

// A recipe of 400 kB goes into each frame.
TEST(StoreSetup, frames_stay_within_their_megabytes) {
    const TempFolder folder;
    lab::VirtualTime loop;
    Config config;
    config.store.folder = folder.path();
    config.store.frames_mb = 1;
    config.store.free_mb = 0;
    std::string text;
    std::uint32_t state = 1;
    while (text.size() < 400'000)
        text += static_cast<char>('!' + (state = state * 1664525U + 1013904223U) / 46'000'000U);
    const auto recorder = make_recorder(loop, config, recorded_frames(text), {});
    for (std::uint32_t part = 1; part <= 5; ++part) inspected(*recorder, part, algo::Verdict::reject);
    EXPECT_THAT(recorder->finish(), IsEmpty());
    const auto kept = *list_frames(folder.path() / kFramesFolder);
    ASSERT_THAT(kept, ::testing::Not(IsEmpty()));
    std::uint64_t bytes = 0;
    for (const ArchivedFile& file : kept) bytes += file.bytes;
    EXPECT_LE(bytes, 1'000'000U);
    EXPECT_GT(bytes + kept.back().bytes, 1'000'000U);
    EXPECT_EQ(kept.back().number, 5U);
}

TEST(StoreSetup, a_folder_of_frames_that_cannot_be_used_is_a_fault_of_the_frames_alone) {
    const TempFolder folder;
    lab::VirtualTime loop;
    Config config;
    config.store.folder = folder.path();
    config.store.frames_mb = 1;
    write_text(folder.path() / kFramesFolder, "a file is in the way");
    std::vector<std::string> troubles;
    std::uint32_t faults = 0;
    const auto recorder = make_recorder(
        loop, config, recorded_frames("x"),
        {[&](const Error& error) { troubles.push_back(error.what); }, [&](std::uint32_t now) { faults = now; }});
    inspected(*recorder, 1, algo::Verdict::reject);
    while (faults == 0 && !::testing::Test::HasFailure()) {
        if (!loop.run_one()) std::this_thread::yield();
    }
    recorder->finish();
    while (loop.run_one()) {
    }
    EXPECT_EQ(faults, std::uint32_t{kFaultPictures});
    EXPECT_THAT(troubles, ElementsAre(HasSubstr((folder.path() / kFramesFolder).string())));
}

TEST(StoreSetup, a_folder_of_frames_that_can_be_used_again_ends_the_fault_without_a_further_frame) {
    const TempFolder folder;
    lab::VirtualTime loop;
    Config config;
    config.store.folder = folder.path();
    config.store.free_mb = 0;
    write_text(folder.path() / kFramesFolder, "a file is in the way");
    std::uint32_t faults = 0;
    const auto recorder =
        make_recorder(loop, config, recorded_frames("x"), {{}, [&](std::uint32_t now) { faults = now; }});
    inspected(*recorder, 1, algo::Verdict::reject);
    while (faults == 0 && !::testing::Test::HasFailure()) {
        if (!loop.run_one()) std::this_thread::yield();
    }
    EXPECT_EQ(faults, std::uint32_t{kFaultPictures});
    std::filesystem::remove(folder.path() / kFramesFolder);
    EXPECT_THAT(recorder->finish(), IsEmpty());
    while (loop.run_one()) {
    }
    EXPECT_EQ(faults, 0U);
    EXPECT_TRUE(std::filesystem::is_empty(folder.path() / kFramesFolder));
}

}  // namespace
}  // namespace hord::firmware::store::test
