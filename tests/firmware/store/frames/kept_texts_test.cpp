// What stands in kept frames, in replays and in an archive's folder, as text.
#include <csignal>

#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/store/frames/frame_archive.h"
#include "firmware/store/frames/frame_metadata.h"
#include "firmware/store/frames/frame_png.h"
#include "firmware/store/frames/replay.h"
#include "firmware/store/frames/replay_shard.h"
#include "firmware/store/results/records.h"
#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::store::test {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

FrameMetadata metadata() {
    const std::vector<algo::Defect> defects = result(2, PartVerdict::reject).defects;
    FrameMetadata data;
    data.station = "cell 3";
    data.software = "0.1.0";
    data.boot = 7;
    data.part = 12;
    data.time_us = kNoon;
    data.role = "before";
    data.trigger = 13;
    data.grid = {24, 20, 5, 4};
    data.bits = 12;
    data.dark_dn = 17;
    data.judgement = {
        "reject", "neighbours-disagree", 1.7F, to_json(std::span<const algo::Defect>(defects)), "ab", true, true, true};
    data.samples_sha256 = "cd";
    data.recipe = "limit = 1\n";
    return data;
}

constexpr const char* kText =
    R"({"hord":1,"station":"cell 3","software":"0.1.0","boot":7,"part":12,"time_us":1790000000000000,"role":"before",)"
    R"("trigger":13,"kind":"macro-pixels","grid":{"m":24,"n":20,"i":5,"j":4},"bits":12,"dark_dn":17,"verdict":"reject",)"
    R"("reason":"neighbours-disagree","score":1.7,"defects":[{"m":12.25,"n":3.5,"area":9,"peak":1.7,"kind":"scratch"},)"
    R"({"m":40,"n":41,"area":4,"peak":1.1,"kind":"absorbing"}],"maps_sha256":"ab","maps":"judged","bounded":true,)"
    R"("out_of_time":true,"samples_sha256":"cd","recipe":"limit = 1\n"})";

TEST(FrameMetadata, is_written_and_read_value_by_value) {
    const FrameMetadata data = metadata();
    EXPECT_EQ(data.to_json(), kText);
    const auto read = FrameMetadata::from_json(kText, "frame");
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_EQ(read->to_json(), kText);
    EXPECT_EQ(read->judgement, data.judgement) << "also the types of the numbers";
    EXPECT_EQ(read->grid, data.grid);
}

TEST(FrameMetadata, has_no_word_for_what_is_as_usual) {
    FrameMetadata data = metadata();
    data.trigger = 0;
    data.dark_dn.reset();
    data.judgement.maps_of_bounds = data.judgement.bounded = data.judgement.out_of_time = false;
    const std::string text = data.to_json();
    for (const char* name : {"trigger", "dark_dn", "maps\"", "bounded", "out_of_time"})
        EXPECT_EQ(text.find(name), std::string::npos) << name;
    const auto read = FrameMetadata::from_json(text, "frame");
    ASSERT_TRUE(read);
    EXPECT_EQ(read->trigger, 0U);
    EXPECT_FALSE(read->dark_dn);
    EXPECT_EQ(read->judgement, data.judgement);
}

TEST(FrameMetadata, without_what_a_replay_needs_is_unreadable_and_with_the_rest_missing_is_not) {
    const Json whole = Json::parse(kText);
    for (const auto& [name, value] : whole.items()) {
        Json cut = whole;
        cut.erase(name);
        const bool may_lack = name == "station" || name == "software" || name == "time_us" || name == "trigger" ||
            name == "kind" || name == "bits" || name == "dark_dn" || name == "maps" || name == "bounded" ||
            name == "out_of_time";
        const auto read = FrameMetadata::from_json(cut.dump(), "f.png");
        ASSERT_EQ(read.has_value(), may_lack) << name;
        if (read) continue;
        EXPECT_EQ(read.error().code, ErrorCode::unreadable);
        EXPECT_THAT(read.error().what, HasSubstr("f.png"));
    }
    Json cut = whole;
    cut.erase("bits");
    EXPECT_EQ(FrameMetadata::from_json(cut.dump(), "f")->bits, 8);
    EXPECT_FALSE(FrameMetadata::from_json("{", "f"));
    EXPECT_FALSE(FrameMetadata::from_json("[]", "f"));
}

TEST(FrameMetadata, has_whole_numbers_that_their_types_can_hold) {
    for (const char* name :
         {"/boot", "/part", "/time_us", "/trigger", "/grid/m", "/grid/j", "/bits", "/dark_dn", "/defects/0/area"}) {
        for (const char* number : {"-1e99", "1e99", "2.5", "18446744073709551616", "\"2\""}) {
            Json other = Json::parse(kText);
            other.at(Json::json_pointer(name)) = Json::parse(number);
            EXPECT_FALSE(FrameMetadata::from_json(other.dump(), "f")) << name << " " << number;
        }
    }
    Json other = Json::parse(kText);
    other["boot"] = 4'294'967'296;
    EXPECT_FALSE(FrameMetadata::from_json(other.dump(), "f"));
    other["boot"] = -1;
    EXPECT_FALSE(FrameMetadata::from_json(other.dump(), "f"));
}

TEST(FramePng, that_cannot_be_read_or_was_not_kept_by_a_station_is_named) {
    const TempFolder folder;
    const auto gone = read_annotated_frame(folder.path() / "none.png");
    ASSERT_FALSE(gone);
    EXPECT_EQ(gone.error().code, ErrorCode::not_found);
    EXPECT_THAT(gone.error().what, HasSubstr("none.png cannot be read"));
    write_text(folder.path() / "text.png", "no image");
    EXPECT_THAT(read_annotated_frame(folder.path() / "text.png").error().cure, HasSubstr("leave it out"));
}

// -- replay

TEST(Replay, names_each_thing_that_changed_and_nothing_else) {
    Replayed same;
    same.frame = "a.png";
    same.part = 5;
    same.role = "reject";
    same.recipe_then = same.recipe_now = "lens";
    same.sentence = "It has a scratch.";
    same.then = same.now = {"reject", "neighbours-disagree", 2.5F, Json::array(), "one"};
    EXPECT_EQ(
        to_json_line(same),
        R"({"frame":"a.png","part":5,"role":"reject","recipe_then":"lens","recipe_now":"lens",)"
        R"("then":{"verdict":"reject","reason":"neighbours-disagree","score":2.5,"defects":[],"maps_sha256":"one"},)"
        R"("now":{"verdict":"reject","reason":"neighbours-disagree","score":2.5,"defects":[],"maps_sha256":"one"},)"
        R"("explain":"It has a scratch.","changes":[]})");
    const auto changes = [&](auto change) {
        Replayed other = same;
        change(other);
        const std::string line = to_json_line(other);
        EXPECT_EQ(other.same(), line.ends_with("[]}"));
        return line.substr(line.rfind('[') + 1, line.size() - line.rfind('[') - 3);
    };
    EXPECT_EQ(changes([](Replayed& r) { r.now.verdict = "pass"; }), "\"verdict\"");
    EXPECT_EQ(changes([](Replayed& r) { r.now.reason = "none"; }), "\"reason\"");
    EXPECT_EQ(changes([](Replayed& r) { r.now.score = 2; }), "\"score\"");
    EXPECT_EQ(changes([](Replayed& r) { r.now.defects.push_back(1); }), "\"defects\"");
    EXPECT_EQ(changes([](Replayed& r) { r.now.maps_sha256 = "two"; }), "\"maps\"");
    EXPECT_EQ(changes([](Replayed& r) { r.now.bounded = true; }), "") << "score and defects say it";
    const auto other_maps = [&](bool same_recipe, bool bounds) {
        return changes([&](Replayed& r) {
            r.now.maps_sha256 = "two";
            r.same_recipe = same_recipe;
            r.then.maps_of_bounds = bounds;
        });
    };
    EXPECT_EQ(other_maps(true, true), "\"maps\"");
    EXPECT_EQ(other_maps(false, false), "\"maps\"");
    EXPECT_EQ(other_maps(false, true), "") << "another recipe solves other gradients";
}

TEST(ReplayShard, has_its_file_alone_in_the_folder_for_everybody_to_read) {
    const TempFolder folder;
    const ReplayIdentity identity{"a", 1, "own", "0.1.0", "b"};
    const auto entries = [&] { return std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()); };
    {
        auto given_up = ShardWriter::create(folder.path() / "s", identity, {});
        ASSERT_TRUE(given_up);
        EXPECT_EQ(entries(), 1) << "the unfinished one";
    }
    EXPECT_EQ(entries(), 0);
    auto writer = ShardWriter::create(folder.path() / "s", identity, {});
    ASSERT_TRUE(writer);
    const std::string line = R"({"frame":"a.png","part":1,"changes":[]})";
    ASSERT_TRUE(writer->add(line));
    const auto tally = writer->finish();
    ASSERT_TRUE(tally);
    EXPECT_EQ(tally->records, 1U);
    EXPECT_EQ(tally->same, 1U);
    EXPECT_EQ(tally->verdicts, 0U);
    EXPECT_EQ(tally->unreadable, 0U);
    EXPECT_EQ(entries(), 1);
    EXPECT_EQ(fs::status(folder.path() / "s").permissions(), static_cast<fs::perms>(0644));
    const std::string head =
        R"({"hord_replay":1,"archive":"a","frames":1,"recipe":"own","software":"0.1.0","program":"b","shard":"1/1"})"
        "\n" +
        line + "\n";
    EXPECT_EQ(read_text(folder.path() / "s"),
              head + R"({"records":1,"same":1,"verdicts":0,"unreadable":0,"sha256":")" + text_identity(head) + "\"}\n");
}

// The lines are larger than what is written at once. Ends the process: 0 refused and nothing left, 1 not.
[[noreturn]] void write_beyond_the_limit(const fs::path& file) {
    (void)std::signal(SIGXFSZ, SIG_IGN);
    const rlimit small{200'000, 200'000};
    bool good = ::setrlimit(RLIMIT_FSIZE, &small) == 0;
    {
        auto writer = ShardWriter::create(file, {"a", 9, "own", "0.1.0", "b"}, {});
        Result<void> done;
        int added = 0;
        for (; writer && done && added < 9; ++added) done = writer->add(std::string(60'000, 'x'));
        good =
            good && added == 4 && !done && done.error().what == file.string() + " cannot be written (File too large)";
    }
    ::_exit(good && fs::is_empty(file.parent_path()) ? 0 : 1);
}

TEST(ReplayShard, that_cannot_be_written_whole_is_not_there) {
    const TempFolder folder;
    const pid_t child = ::fork();
    if (child == 0) write_beyond_the_limit(folder.path() / "s");
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_TRUE(WIFEXITED(status));
    EXPECT_EQ(WEXITSTATUS(status), 0);
}

TEST(ReplayShard, tells_a_damaged_frame_from_a_recipe_that_does_not_fit) {
    EXPECT_EQ(unreadable_line("a\"b", ErrorCode::unreadable), R"({"frame":"a\"b","unreadable":"damaged"})");
    EXPECT_EQ(unreadable_line("a", ErrorCode::invalid_argument),
              R"({"frame":"a","unreadable":"the recipe does not fit it"})");
}

// -- the folder of an archive

TEST(FrameArchive, takes_for_its_frames_only_files_with_such_names) {
    const TempFolder folder;
    for (const char* name : {"000000000002-b.png", "000000000001-a.png", "00000000003-c.png", "0000000000004-d.png",
                             "000000000005_e.png", "000000000006-.png", "000000000007-f.jpg", "00000000000x-g.png",
                             "000000000000-h.png", "000000000008-i.png.gz", "-00000000009-j.png"})
        write_text(folder.path() / name, std::string(name).substr(0, 14));
    const auto files = list_frames(folder.path());
    ASSERT_TRUE(files);
    std::vector<std::string> found;
    for (const ArchivedFile& file : *files) {
        found.push_back(std::to_string(file.number) + " " + file.file.filename().string());
        EXPECT_EQ(file.bytes, 14U);
    }
    EXPECT_THAT(found, ElementsAre("1 000000000001-a.png", "2 000000000002-b.png", "6 000000000006-.png"));
    const auto gone = list_frames(folder.path() / "none");
    ASSERT_FALSE(gone);
    EXPECT_EQ(gone.error().code, ErrorCode::not_found);
}

TEST(FrameArchive, counts_what_it_finds_and_adds_up_to_its_limit_exactly) {
    const TempFolder folder;
    write_text(folder.path() / "000000000041-x.png", std::string(1000, 'x'));
    write_text(folder.path() / "000000000007-y.png", std::string(500, 'y'));
    auto archive = FrameArchive::open(folder.path(), {.max_bytes = 2500, .min_free_bytes = 0});
    ASSERT_TRUE(archive);
    EXPECT_EQ((*archive)->bytes(), 1500U);
    EXPECT_EQ((*archive)->count(), 2U);
    EXPECT_EQ((*archive)->next_number(), 42U);
    const std::vector<std::uint8_t> thousand(1000, 1);
    ASSERT_TRUE((*archive)->add("a", thousand));
    EXPECT_EQ((*archive)->bytes(), 2500U) << "nothing was removed";
    ASSERT_TRUE((*archive)->add("b", thousand));
    EXPECT_EQ((*archive)->bytes(), 2000U) << "the two oldest, by their numbers";
    EXPECT_EQ(fs::status(folder.path() / "000000000043-b.png").permissions(), static_cast<fs::perms>(0644))
        << "everybody may look at it";
    ASSERT_TRUE((*archive)->add("c", std::vector<std::uint8_t>(2500))) << "alone it is not too large";
    EXPECT_EQ((*archive)->count(), 1U);
    const auto refused = (*archive)->add("d", std::vector<std::uint8_t>(2501));
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().what, HasSubstr("2501 bytes"));
    EXPECT_EQ((*archive)->count(), 1U) << "and nothing makes room for it";
}

TEST(FrameArchive, reads_the_room_that_the_disk_really_has) {
    const TempFolder folder;
    const auto free = real_disk().free_bytes(folder.path());
    ASSERT_TRUE(free);
    const auto space = fs::space(folder.path());
    EXPECT_NEAR(static_cast<double>(*free), static_cast<double>(space.available),
                0.1 * static_cast<double>(space.capacity));
    const auto gone = real_disk().free_bytes(folder.path() / "none");
    ASSERT_FALSE(gone);
    EXPECT_THAT(gone.error().what, HasSubstr("something removed it"));
}

}  // namespace
}  // namespace hord::firmware::store::test
