// Teach-in: takes frames from the line, stores them on the disk, learns, and leaves only the recipe and its reference.
#include "firmware/recipes/teach_in.h"

#include <atomic>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <semaphore>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "firmware/recipes/reference_file.h"
#include "lab/virtual_time/virtual_time.h"
#include "tests/firmware/recipes/drawn_lens.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;
using ::testing::UnorderedElementsAre;

algo::Inspection seen(algo::Reason reason = algo::Reason::none) {
    algo::Inspection inspection;
    inspection.reason = reason;
    return inspection;
}

class TeachInTest : public ::testing::Test {
  protected:
    TeachInTest() {
        std::string name = fs::temp_directory_path() / "hord-teacher-XXXXXX";
        folder = ::mkdtemp(name.data());
        recipe.number = 7;
        recipe.recipe.name = "lens";
        recipe.recipe.emd_limit_bins =
            3;  // a drawn lens has seven narrow bins: its own gradients must not count as defects
        recipe.recipe.frobenius_limit_bins = 3;
        recipe.recipe.transmission_limit = 0.5F;
    }
    ~TeachInTest() override {
        teacher.reset();
        fs::remove_all(folder);
    }
    void open(hal::EventLoop& on, bool thread = false) {
        TeachInOptions options;
        options.extents = kDrawnExtents;
        options.bits = kDrawnBits;
        options.folder = folder;
        options.thread = thread;
        options.check_folder = check_folder;
        teacher = std::make_unique<LineTeachIn>(on, options);
    }
    Result<void> begin(std::uint32_t parts) {
        return teacher->begin(parts, recipe,
                              {[this](std::uint32_t k) { taken = k; },
                               [this](Result<TeachResult> r) { outcomes.push_back(std::move(r)); }});
    }
    void inspected(std::uint32_t part, const Frame& frame, algo::Reason reason = algo::Reason::none) {
        teacher->on_inspection(part, frame.view(), seen(reason));
        loop.run_for(milliseconds(1));
    }
    void good_parts(std::uint32_t from, std::uint32_t count) {
        for (std::uint32_t k = from; k < from + count; ++k) inspected(k, drawn_lens(k));
    }
    std::vector<std::string> files(const std::string& below = "") const {
        std::vector<std::string> names;
        for (const auto& entry : fs::recursive_directory_iterator(folder / below)) {
            if (entry.is_regular_file()) names.push_back(fs::relative(entry.path(), folder));
        }
        return names;
    }
    algo::Verdict verdict_of(const Frame& frame, const NumberedRecipe& with) {
        auto pipeline = algo::Pipeline::create(kDrawnExtents, kDrawnBits, with.recipe);
        EXPECT_TRUE(pipeline) << pipeline.error().message();
        return pipeline->inspect(frame.view())->verdict;
    }

    fs::path folder;
    lab::VirtualTime loop;
    NumberedRecipe recipe;
    std::unique_ptr<LineTeachIn> teacher;
    std::uint32_t taken = 0;
    std::vector<Result<TeachResult>> outcomes;
    std::function<Result<void>()> check_folder;  // see TeachInOptions
};

TEST_F(TeachInTest, refuses_at_once_what_a_reference_does_not_go_with) {
    open(loop);
    recipe.recipe.gradient = algo::Feature::chi2;
    recipe.recipe.gradient_limit = 1;
    const auto refused = begin(9);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::refused);
    EXPECT_NE(refused.error().what.find("compares neighbours by chi2"), std::string::npos) << refused.error().what;
    recipe.recipe.gradient.reset();
    recipe.recipe.gradient_limit = 0;
    EXPECT_TRUE(begin(9));
}

TEST_F(TeachInTest, says_that_frames_repeat_a_part) {
    open(loop);
    ASSERT_TRUE(begin(12));
    good_parts(1, 9);
    for (std::uint32_t k = 10; k < 13; ++k) inspected(k, drawn_lens(9));
    ASSERT_EQ(outcomes.size(), 1U);
    ASSERT_TRUE(outcomes[0]) << outcomes[0].error().message();
    EXPECT_THAT(outcomes[0]->remarks, HasSubstr("12 frames show 9 distinct parts: 3 are copies of earlier ones"));
}

TEST_F(TeachInTest, copies_of_a_bad_part_do_not_support_each_other) {
    open(loop);
    ASSERT_TRUE(begin(12));
    good_parts(1, 9);
    for (std::uint32_t k = 10; k < 13; ++k) inspected(k, drawn_lens(50, true));
    ASSERT_EQ(outcomes.size(), 1U);
    ASSERT_TRUE(outcomes[0]) << outcomes[0].error().message();
    EXPECT_EQ(outcomes[0]->recipe.recipe.reference->parts, 9U);
    EXPECT_THAT(outcomes[0]->remarks, HasSubstr("part 10 was left out"));
    EXPECT_EQ(verdict_of(drawn_lens(101, true), outcomes[0]->recipe), algo::Verdict::reject);
}

TEST_F(TeachInTest, frames_of_too_few_parts_teach_nothing) {
    open(loop);
    ASSERT_TRUE(begin(9));
    for (std::uint32_t k = 1; k < 10; ++k) inspected(k, drawn_lens(k % 3));
    ASSERT_EQ(outcomes.size(), 1U);
    ASSERT_FALSE(outcomes[0]);
    EXPECT_EQ(outcomes[0].error().code, ErrorCode::invalid_argument);
    EXPECT_THAT(outcomes[0].error().what, HasSubstr("9 frames show 3 distinct parts"));
    EXPECT_THAT(outcomes[0].error().cure, HasSubstr("at least 5 more"));
    EXPECT_THAT(files(), IsEmpty());
}

TEST_F(TeachInTest, learns_from_the_next_parts_what_tells_good_from_bad) {
    open(loop);
    ASSERT_TRUE(begin(9));
    good_parts(1, 8);
    EXPECT_EQ(taken, 8U);
    EXPECT_EQ(files("teach").size(), 8U);
    EXPECT_TRUE(outcomes.empty());
    good_parts(9, 1);
    ASSERT_EQ(outcomes.size(), 1U);
    ASSERT_TRUE(outcomes[0]) << outcomes[0].error().message();
    const NumberedRecipe& taught = outcomes[0]->recipe;
    // Deflections that change evenly, everywhere: a shift looks as a tilt does.
    EXPECT_THAT(outcomes[0]->remarks, StartsWith("No place of the field shows photon noise alone"));
    EXPECT_THAT(outcomes[0]->remarks, HasSubstr("Pose not determined: the shift along x, the shift along y; "));
    EXPECT_EQ(taught.recipe.reference->parts, 9U);
    EXPECT_EQ(taught.number, 7);
    EXPECT_NE(crc32_of(taught), crc32_of(recipe));
    EXPECT_EQ(verdict_of(drawn_lens(100), taught), algo::Verdict::pass);
    EXPECT_EQ(verdict_of(drawn_lens(101, true), taught), algo::Verdict::reject);
    NumberedRecipe without = recipe;
    without.recipe.part_required = false;                                        // the lens fills the field
    EXPECT_EQ(verdict_of(drawn_lens(101, true), without), algo::Verdict::pass);  // because of the reference
    EXPECT_THAT(files(), UnorderedElementsAre("references/taught-7-1.hordref", "recipe-taught.toml"));
    good_parts(20, 3);  // later parts are not taken
    EXPECT_EQ(taken, 9U);
}

TEST_F(TeachInTest, takes_what_shows_a_part_whatever_the_verdict_and_nothing_else) {
    open(loop);
    inspected(1, drawn_lens(1));  // before the session began
    ASSERT_TRUE(begin(8));
    for (const auto reason : {algo::Reason::too_dark, algo::Reason::saturated, algo::Reason::nothing_to_see,
                              algo::Reason::no_part, algo::Reason::unexpected_light, algo::Reason::unexpected_geometry})
        inspected(2, drawn_lens(2), reason);
    inspected(0xFFFFFFFF, drawn_lens(3));     // the station's own test
    inspected(4, Frame(14, 14, kDrawnBits));  // another size
    inspected(5, Frame(kDrawnExtents.width_px(), kDrawnExtents.height_px(), 8));
    EXPECT_EQ(taken, 0U);
    for (const auto reason : {algo::Reason::none, algo::Reason::neighbours_disagree, algo::Reason::deflection_gradient,
                              algo::Reason::absorption, algo::Reason::not_registered}) {
        inspected(6, drawn_lens(6), reason);
    }
    EXPECT_EQ(taken, 5U);
}

TEST_F(TeachInTest, a_part_that_comes_while_the_one_before_is_written_is_passed_over) {
    open(loop);
    ASSERT_TRUE(begin(8));
    const Frame frame = drawn_lens(1);
    teacher->on_inspection(1, frame.view(), seen());
    teacher->on_inspection(2, frame.view(), seen());
    teacher->on_inspection(3, frame.view(), seen());
    loop.run_for(milliseconds(1));
    EXPECT_EQ(taken, 1U);
    teacher->on_inspection(4, frame.view(), seen());
    loop.run_for(milliseconds(1));
    EXPECT_EQ(taken, 2U);
}

TEST_F(TeachInTest, rows_with_padding_are_kept_without_it) {
    open(loop);
    ASSERT_TRUE(begin(8));
    const Frame frame = drawn_lens(1);
    const std::size_t row = static_cast<std::size_t>(frame.width_px()) * 2, stride = row + 14;
    std::vector<std::byte> padded(stride * static_cast<std::size_t>(frame.height_px()), std::byte{0xFF});
    for (std::size_t y = 0; y < static_cast<std::size_t>(frame.height_px()); ++y)
        std::copy_n(frame.bytes().begin() + static_cast<std::ptrdiff_t>(y * row), row,
                    padded.begin() + static_cast<std::ptrdiff_t>(y * stride));
    FrameView view = frame.view();
    view.data = padded.data();
    view.stride_bytes = static_cast<std::ptrdiff_t>(stride);
    teacher->on_inspection(1, view, seen());
    loop.run_for(milliseconds(1));
    std::ifstream in(folder / "teach/part-01.raw", std::ios::binary);
    const std::string kept{std::istreambuf_iterator<char>(in), {}};
    EXPECT_TRUE(kept == std::string(reinterpret_cast<const char*>(frame.bytes().data()), frame.bytes().size()));
}

TEST_F(TeachInTest, a_part_unlike_the_others_is_left_out_by_its_number) {
    open(loop);
    ASSERT_TRUE(begin(10));
    good_parts(41, 9);
    Frame empty(kDrawnExtents.width_px(), kDrawnExtents.height_px(), kDrawnBits);
    inspected(50, empty);
    ASSERT_EQ(outcomes.size(), 1U);
    ASSERT_TRUE(outcomes[0]) << outcomes[0].error().message();
    EXPECT_EQ(outcomes[0]->recipe.recipe.reference->parts, 9U);
    EXPECT_THAT(outcomes[0]->remarks, HasSubstr("part 50 was left out"));
}

TEST_F(TeachInTest, parts_of_which_too_few_are_alike_teach_nothing_and_leave_nothing) {
    open(loop);
    ASSERT_TRUE(begin(8));
    good_parts(1, 7);
    inspected(8, Frame(kDrawnExtents.width_px(), kDrawnExtents.height_px(), kDrawnBits));
    ASSERT_EQ(outcomes.size(), 1U);
    ASSERT_FALSE(outcomes[0]);
    EXPECT_EQ(outcomes[0].error().code, ErrorCode::invalid_argument);
    EXPECT_THAT(outcomes[0].error().what, HasSubstr("7 of 8 parts"));
    EXPECT_THAT(files(), IsEmpty());
    ASSERT_TRUE(begin(8));  // the next session starts normally
    good_parts(1, 8);
    ASSERT_EQ(outcomes.size(), 2U);
    EXPECT_TRUE(outcomes[1]) << outcomes[1].error().message();
}

TEST_F(TeachInTest, a_recipe_that_passes_nothing_with_its_reference_is_not_taught) {
    open(loop);
    recipe.recipe.reject_score = recipe.recipe.cluster_score = 1;  // noise alone exceeds these limits
    recipe.recipe.grow_score = 0.5F;
    ASSERT_TRUE(begin(8));
    good_parts(1, 8);
    ASSERT_EQ(outcomes.size(), 1U);
    ASSERT_FALSE(outcomes[0]);
    EXPECT_THAT(outcomes[0].error().what, HasSubstr("would pass only 0 of the 8 parts"));
    EXPECT_THAT(files(), IsEmpty());
}

// -- the disk

// Limits the size of files, as a full disk does: further writes fail.
class SmallFiles {
  public:
    explicit SmallFiles(rlim_t bytes) {
        before_handler_ = ::signal(SIGXFSZ, SIG_IGN);
        ::getrlimit(RLIMIT_FSIZE, &before_);
        rlimit now = before_;
        now.rlim_cur = bytes;
        ::setrlimit(RLIMIT_FSIZE, &now);
    }
    ~SmallFiles() {
        ::setrlimit(RLIMIT_FSIZE, &before_);
        ::signal(SIGXFSZ, before_handler_);
    }
    SmallFiles(const SmallFiles&) = delete;
    SmallFiles& operator=(const SmallFiles&) = delete;

  private:
    rlimit before_{};
    void (*before_handler_)(int) = nullptr;
};

TEST_F(TeachInTest, a_disk_that_takes_no_more_frames_ends_it_and_nothing_is_left) {
    open(loop);
    ASSERT_TRUE(begin(8));
    good_parts(1, 3);
    {
        const SmallFiles full(10'000);
        good_parts(4, 1);
    }
    ASSERT_EQ(outcomes.size(), 1U);
    ASSERT_FALSE(outcomes[0]);
    EXPECT_EQ(outcomes[0].error().code, ErrorCode::io);
    EXPECT_THAT(outcomes[0].error().message(), HasSubstr("part-04.raw cannot be written"));
    EXPECT_THAT(files(), IsEmpty());
    good_parts(5, 2);
    EXPECT_EQ(taken, 3U);
}

TEST_F(TeachInTest, a_disk_without_room_for_the_reference_ends_it_and_nothing_is_left) {
    open(loop);
    ASSERT_TRUE(begin(8));
    good_parts(1, 7);
    {
        const SmallFiles full(30'000);  // a frame has 28,224 bytes, a reference more than 60,000
        good_parts(8, 1);
    }
    ASSERT_EQ(outcomes.size(), 1U);
    ASSERT_FALSE(outcomes[0]);
    EXPECT_EQ(outcomes[0].error().code, ErrorCode::io);
    EXPECT_THAT(outcomes[0].error().message(), HasSubstr("taught-7-1.hordref"));
    EXPECT_THAT(files(), IsEmpty());
}

TEST_F(TeachInTest, is_not_begun_where_the_disk_has_no_room) {
    TeachInOptions options;
    options.extents = kDrawnExtents;
    options.bits = kDrawnBits;
    options.folder = folder;
    options.thread = false;
    options.leave_free_bytes = std::uint64_t{1} << 60U;
    teacher = std::make_unique<LineTeachIn>(loop, options);
    ASSERT_TRUE(begin(8));
    good_parts(1, 1);
    ASSERT_EQ(outcomes.size(), 1U);
    EXPECT_THAT(outcomes[0].error().message(), HasSubstr("make room"));
    EXPECT_EQ(taken, 0U);
}

// -- the end

TEST_F(TeachInTest, cancelled_at_any_moment_it_leaves_nothing_and_tells_nobody) {
    open(loop);
    teacher->cancel();  // nothing to cancel
    for (const std::uint32_t parts : {0U, 5U, 8U}) {
        ASSERT_TRUE(begin(8)) << parts;
        const Frame frame = drawn_lens(1);
        for (std::uint32_t k = 1; k < parts; ++k) inspected(k, drawn_lens(k));
        if (parts > 0) teacher->on_inspection(parts, frame.view(), seen());  // in the slot, not on the disk
        teacher->cancel();
        EXPECT_EQ(begin(8).error().code, ErrorCode::busy);
        loop.run_for(milliseconds(1));
        EXPECT_THAT(files(), IsEmpty()) << parts;
    }
    EXPECT_THAT(outcomes, IsEmpty());
}

TEST_F(TeachInTest, what_a_killed_process_spooled_is_removed_at_the_next_start) {
    fs::create_directories(folder / "teach");
    std::ofstream(folder / "teach/part-01.raw") << "half a frame";
    std::ofstream(folder / "recipe-in-use.toml") << "number = 7\n";
    open(loop);
    EXPECT_THAT(files(), ElementsAre("recipe-in-use.toml"));
}

// Another station may have locked the folder that is at the path since. The folder is lost at the n-th look at it, for
// every n until the teach-in ends well: nothing is written or removed from then on.
TEST_F(TeachInTest, changes_nothing_in_a_folder_that_is_no_longer_the_stations) {
    int looks = 0, lost_at = 1;
    std::vector<std::string> then;
    check_folder = [&]() -> Result<void> {
        if (++looks < lost_at) return {};
        if (looks == lost_at) then = files();
        return fail(ErrorCode::refused, "the state folder was renamed", "put it back");
    };
    std::size_t left_something = 0;
    for (bool learned = false; !learned; ++lost_at) {
        ASSERT_LT(lost_at, 100);
        fs::remove_all(folder);
        fs::create_directory(folder);
        looks = 0;
        outcomes.clear();
        open(loop);
        ASSERT_TRUE(begin(9));
        loop.run_for(milliseconds(1));
        good_parts(1, 9);
        ASSERT_EQ(outcomes.size(), 1U) << lost_at;
        learned = outcomes[0].has_value();
        if (!learned) {
            EXPECT_EQ(outcomes[0].error().what, "the state folder was renamed") << lost_at;
        }
        teacher.reset();
        if (looks < lost_at) break;
        EXPECT_EQ(files(), then) << "lost at look " << lost_at;
        left_something += then.empty() ? 0 : 1;
    }
    EXPECT_GT(lost_at, 12) << "it looks before each part and before the reference";
    EXPECT_GT(left_something, 8U);
}

TEST_F(TeachInTest, what_waits_for_the_line_to_stop_is_found_by_the_next_process) {
    open(loop);
    ASSERT_TRUE(begin(8));
    good_parts(1, 8);
    ASSERT_TRUE(outcomes.at(0)) << outcomes[0].error().message();
    const std::uint32_t taught = crc32_of(outcomes[0]->recipe);
    open(loop);
    const auto waiting = LineTeachIn::pending_recipe(folder, recipe);
    ASSERT_TRUE(waiting && *waiting);
    const NumberedRecipe& found = (*waiting)->recipe.value();
    EXPECT_EQ(crc32_of(found), taught);
    EXPECT_NE(found.recipe.reference, nullptr);
    NumberedRecipe other = recipe;
    other.recipe.min_area = 3;
    EXPECT_FALSE(LineTeachIn::pending_recipe(folder, other)->has_value());  // the teach-in was for another recipe

    teacher->in_use(found);
    EXPECT_FALSE(LineTeachIn::pending_recipe(folder, recipe)->has_value());
    EXPECT_THAT(files(), ElementsAre("references/taught-7-1.hordref"));
}

TEST_F(TeachInTest, the_newest_of_a_recipe_is_kept_and_that_of_others) {
    open(loop);
    fs::create_directories(folder / "references");
    for (const char* name :
         {"taught-7-1.hordref", "taught-7-9.hordref", "taught-70-2.hordref", "taught-7-mine.hordref", "mine.hordref"})
        std::ofstream(folder / "references" / name) << "x";
    ASSERT_TRUE(begin(8));
    good_parts(1, 8);
    ASSERT_TRUE(outcomes.at(0)) << outcomes[0].error().message();
    EXPECT_EQ(outcomes[0]->recipe.reference_file.filename(), "taught-7-10.hordref");
    teacher->in_use(outcomes[0]->recipe);
    EXPECT_THAT(files(),
                UnorderedElementsAre("references/taught-7-10.hordref", "references/taught-70-2.hordref",
                                     "references/taught-7-mine.hordref", "references/mine.hordref"));
}

// -- threads

TEST_F(TeachInTest, learns_on_a_thread_of_its_own_while_several_inspect) {
    auto real = SdEventLoop::open();
    ASSERT_TRUE(real) << real.error().message();
    open(**real, true);
    std::vector<Frame> frames;
    for (std::uint32_t k = 1; k <= 16; ++k) frames.push_back(drawn_lens(k));
    constexpr int kThreads = 2;
    std::counting_semaphore<> parts(0);
    std::atomic<std::size_t> next{0};
    std::atomic<bool> enough{false};
    std::vector<std::thread> inspecting;
    for (int t = 0; t < kThreads; ++t) {
        inspecting.emplace_back([&] {
            for (parts.acquire(); !enough; parts.acquire()) {
                const std::size_t k = next++ % frames.size();
                teacher->on_inspection(static_cast<std::uint32_t>(k + 1), frames[k].view(), seen());
            }
        });
    }
    TeachIn::Listener listener;
    listener.taken = [&](std::uint32_t k) {
        taken = k;
        parts.release(kThreads);  // both bring one at the same time
    };
    listener.done = [&](Result<TeachResult> r) {
        outcomes.push_back(std::move(r));
        (*real)->request_stop();
    };
    ASSERT_TRUE(teacher->begin(12, recipe, std::move(listener)));
    EXPECT_TRUE((*real)->run());
    enough = true;
    parts.release(kThreads);
    for (std::thread& thread : inspecting) thread.join();
    EXPECT_EQ(taken, 12U);
    ASSERT_EQ(outcomes.size(), 1U);
    EXPECT_TRUE(outcomes[0]) << outcomes[0].error().message();
    EXPECT_FALSE(fs::exists(folder / "teach"));
    teacher.reset();
}

TEST_F(TeachInTest, that_goes_while_it_waits_for_parts_or_learns_leaves_nothing) {
    auto real = SdEventLoop::open();
    ASSERT_TRUE(real) << real.error().message();
    for (const std::uint32_t parts : {0U, 3U, 8U}) {
        open(**real, true);
        TeachIn::Listener listener;
        listener.taken = [&](std::uint32_t k) {
            if (k == parts) return (*real)->request_stop();
            const Frame frame = drawn_lens(k + 1);
            teacher->on_inspection(k + 1, frame.view(), seen());
        };
        listener.done = [&](Result<TeachResult> r) { outcomes.push_back(std::move(r)); };
        ASSERT_TRUE(teacher->begin(8, recipe, std::move(listener)));
        EXPECT_TRUE((*real)->run());
        teacher.reset();
        EXPECT_THAT(files(), IsEmpty()) << parts;
    }
    EXPECT_THAT(outcomes, IsEmpty());
}

}  // namespace
}  // namespace hord::firmware
