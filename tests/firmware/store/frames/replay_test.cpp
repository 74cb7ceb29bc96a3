// A second inspection of retained frames has bit-identical results.

#include "firmware/store/frames/replay.h"

#include <atomic>

#include <nlohmann/json.hpp>

#include "firmware/store/frames/frame_png.h"
#include "firmware/store/frames/replay_run.h"
#include "tests/firmware/store/frames/retained_parts.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;
using Json = nlohmann::json;

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

}  // namespace
}  // namespace hord::firmware::store::test
