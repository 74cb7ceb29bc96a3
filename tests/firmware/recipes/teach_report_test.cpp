// The report of a taught reference: written after the outcome is told, removed with its reference, stopped by what
// comes.
#include <atomic>
#include <filesystem>
#include <fstream>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "firmware/recipes/reference_file.h"
#include "firmware/recipes/teach_in.h"
#include "lab/virtual_time/virtual_time.h"
#include "tests/firmware/recipes/drawn_lens.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::UnorderedElementsAre;

constexpr const char* kReference = "references/taught-7-1.hordref";

class TeachReport : public ::testing::Test {
  protected:
    TeachReport() {
        std::string name = fs::temp_directory_path() / "hord-teach-report-XXXXXX";
        folder = ::mkdtemp(name.data());
        recipe.number = 7;
        recipe.recipe.emd_limit_bins = recipe.recipe.frobenius_limit_bins = 3;
        recipe.recipe.transmission_limit = 0.5F;
    }
    ~TeachReport() override {
        teacher.reset();
        fs::remove_all(folder);
    }
    void open(hal::EventLoop& on, bool thread = false) {
        TeachInOptions options;
        options.extents = kDrawnExtents;
        options.bits = kDrawnBits;
        options.folder = folder;
        options.thread = thread;
        options.report = [this](const LearnedParts& parts) { return report(parts); };
        options.trouble = [this](const Error& error) { troubles.push_back(error.message()); };
        teacher = std::make_unique<LineTeachIn>(on, options);
    }
    void inspected(std::uint32_t part) {
        const Frame frame = drawn_lens(part);
        algo::Inspection seen;
        seen.reason = algo::Reason::none;
        teacher->on_inspection(part, frame.view(), seen);
    }
    // Teaches in virtual time.
    void teach(std::uint32_t first, std::uint32_t parts) {
        ASSERT_TRUE(
            teacher->begin(parts, recipe, {{}, [this](Result<TeachResult> r) { outcomes.push_back(std::move(r)); }}));
        for (std::uint32_t k = first; k < first + parts; ++k) {
            inspected(k);
            loop.run_for(milliseconds(1));
        }
        ASSERT_TRUE(!outcomes.empty() && outcomes.back()) << outcomes.back().error().message();
    }
    // Begins a teach in real time that gets a part whenever it asks for one.
    void begin(std::function<void(Result<TeachResult>)> done) {
        TeachIn::Listener listener;
        listener.taken = [this](std::uint32_t k) { inspected(k + 1); };
        listener.done = std::move(done);
        ASSERT_TRUE(teacher->begin(8, recipe, std::move(listener)));
    }
    static Result<void> write_all_files(const LearnedParts& parts) {
        for (const std::string_view ending : kReportEndings) std::ofstream(report_file(parts.file, ending)) << "told";
        return {};
    }
    // Reads frames until it is stopped, as a report that takes long.
    std::function<Result<void>(const LearnedParts&)> endless() {
        return [this](const LearnedParts& parts) -> Result<void> {
            ++reporting;
            while (true) {
                const auto frame = parts.frame_of(0);
                if (!frame) break;
            }
            ++stopped;
            return write_all_files(parts);  // as one that was writing when it was stopped
        };
    }
    std::vector<std::string> files() const {
        std::vector<std::string> names;
        for (const auto& entry : fs::recursive_directory_iterator(folder)) {
            if (entry.is_regular_file()) names.push_back(fs::relative(entry.path(), folder));
        }
        return names;
    }

    fs::path folder;
    lab::VirtualTime loop;
    NumberedRecipe recipe;
    std::function<Result<void>(const LearnedParts&)> report = write_all_files;
    std::vector<Result<TeachResult>> outcomes;
    std::vector<std::string> troubles;
    std::atomic<int> reporting{0}, stopped{0};
    std::unique_ptr<LineTeachIn> teacher;
};

TEST_F(TeachReport, is_made_from_the_frames_that_the_reference_was_learned_from) {
    open(loop);
    std::vector<std::string> names;
    std::size_t frames = 0;
    report = [&](const LearnedParts& parts) -> Result<void> {
        names = parts.frames;
        EXPECT_TRUE(fs::exists(parts.file));  // the reference comes first
        EXPECT_TRUE(fs::exists(folder / "recipe-taught.toml"));
        EXPECT_EQ(parts.file, folder / kReference);
        EXPECT_EQ(parts.poses.size(), 9U);
        EXPECT_EQ(parts.reference->parts, 9U);
        EXPECT_FALSE(parts.unsure.empty());
        for (std::size_t k = 0; k < parts.frames.size(); ++k) {
            const auto frame = parts.frame_of(k);
            const Frame as_shown = drawn_lens(31 + k);
            frames += frame && std::ranges::equal(frame->bytes(), as_shown.bytes()) ? 1 : 0;
        }
        return {};
    };
    teach(31, 9);
    EXPECT_THAT(
        names,
        ElementsAre("part 31", "part 32", "part 33", "part 34", "part 35", "part 36", "part 37", "part 38", "part 39"));
    EXPECT_EQ(frames, 9U);
    EXPECT_THAT(files(), UnorderedElementsAre(kReference, "recipe-taught.toml"));  // no frame is left
    EXPECT_THAT(troubles, IsEmpty());
}

TEST_F(TeachReport, that_cannot_be_written_is_told_and_the_reference_stays) {
    open(loop);
    report = [](const LearnedParts& parts) -> Result<void> {
        std::ofstream(report_file(parts.file, ".learn.csv")) << "half";
        return fail(ErrorCode::io, "the disk is full", "make room");
    };
    teach(1, 8);
    loop.run_for(milliseconds(1));
    ASSERT_EQ(troubles.size(), 1U);
    EXPECT_THAT(troubles[0], HasSubstr("taught-7-1.hordref is learned, its report is not written: the disk is full"));
    EXPECT_THAT(troubles[0], HasSubstr("make room"));
    EXPECT_THAT(files(), UnorderedElementsAre(kReference, "recipe-taught.toml"));
    EXPECT_TRUE(read_reference(folder / kReference));
}

TEST_F(TeachReport, goes_with_its_reference) {
    open(loop);
    teach(1, 8);
    EXPECT_EQ(files().size(), 2 + std::size(kReportEndings));
    const NumberedRecipe first = outcomes.back()->recipe;
    teacher->in_use(first);
    EXPECT_EQ(files().size(), 1 + std::size(kReportEndings));
    // As a killed process leaves them: a report without its reference, an unfinished file of one.
    for (const char* name : {"taught-7-4.learn.md", "taught-7-1.learn.png.0a1b2c3d.new"})
        std::ofstream(folder / "references" / name) << "x";
    // Not of these.
    const std::vector<std::string> others = {"taught-70-4.learn.md", "taught-7-mine.learn.md", "taught-7-3.txt",
                                             "mine.learn.json"};
    for (const std::string& name : others) std::ofstream(folder / "references" / name) << "x";
    teach(11, 8);
    EXPECT_EQ(outcomes.back()->recipe.reference_file.filename(), "taught-7-5.hordref");  // no older report is its own
    teacher->in_use(outcomes.back()->recipe);
    std::vector<std::string> expected = {"references/taught-7-5.hordref"};
    for (const std::string_view ending : kReportEndings)
        expected.push_back("references/taught-7-5" + std::string(ending));
    for (const std::string& name : others) expected.push_back("references/" + name);
    EXPECT_THAT(files(), ::testing::UnorderedElementsAreArray(expected));
    teacher->discard(outcomes.back()->recipe);
    EXPECT_EQ(files().size(), others.size());
}

TEST_F(TeachReport, does_not_delay_the_outcome_and_the_next_teach_stops_it) {
    auto real = SdEventLoop::open();
    ASSERT_TRUE(real) << real.error().message();
    open(**real, true);
    report = endless();
    begin([&](Result<TeachResult> first) {
        ASSERT_TRUE(first) << first.error().message();  // while its report is still being made
        teacher->in_use(first->recipe);
        begin([&](Result<TeachResult> second) {
            outcomes.push_back(std::move(second));
            (*real)->request_stop();
        });
    });
    EXPECT_TRUE((*real)->run());
    ASSERT_EQ(outcomes.size(), 1U);
    ASSERT_TRUE(outcomes[0]) << outcomes[0].error().message();
    EXPECT_GE(stopped, reporting - 1);  // the first one was
    teacher.reset();
    EXPECT_EQ(stopped, reporting);
    EXPECT_THAT(files(), UnorderedElementsAre(kReference, "references/taught-7-2.hordref", "recipe-taught.toml"));
    EXPECT_THAT(troubles, IsEmpty());
}

TEST_F(TeachReport, of_a_discarded_reference_is_stopped_and_leaves_nothing) {
    auto real = SdEventLoop::open();
    ASSERT_TRUE(real) << real.error().message();
    open(**real, true);
    report = endless();
    begin([&](Result<TeachResult> taught) {
        ASSERT_TRUE(taught) << taught.error().message();
        teacher->discard(taught->recipe);
        (*real)->request_stop();
    });
    EXPECT_TRUE((*real)->run());
    teacher.reset();
    EXPECT_EQ(stopped, reporting);
    EXPECT_THAT(files(), IsEmpty());
    EXPECT_THAT(troubles, IsEmpty());
}

// -- what a reference's file says of itself

TEST_F(TeachReport, belongs_to_the_reference_of_the_same_checksum) {
    open(loop);
    teach(1, 8);
    const fs::path file = folder / kReference;
    const auto facts = read_reference_facts(file);
    ASSERT_TRUE(facts) << facts.error().message();
    EXPECT_EQ(facts->extents, kDrawnExtents);
    EXPECT_EQ(facts->parts, 8U);
    EXPECT_EQ(facts->crc32, crc32_of(outcomes[0]->recipe.recipe.reference));
    EXPECT_EQ(read_reference_facts(folder / "none").error().code, ErrorCode::not_found);
    for (const std::string& text : {std::string(), std::string("HORDREF\n"), std::string(200, 'x')}) {
        std::ofstream(folder / "damaged") << text;
        EXPECT_FALSE(read_reference_facts(folder / "damaged")) << text.size();
    }
    EXPECT_FALSE(read_reference_facts(folder));
    EXPECT_FALSE(read_reference_facts("/dev/zero"));
}

}  // namespace
}  // namespace hord::firmware
