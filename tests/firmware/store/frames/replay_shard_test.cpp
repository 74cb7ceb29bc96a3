// Shards of a replay. Joined in any number and order, they equal one replay byte for byte. Shards that do not belong
// together or are incomplete are refused by name.
#include "firmware/store/frames/replay_shard.h"

#include <array>
#include <csignal>
#include <random>

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::store::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

const ReplayIdentity kReplay{std::string(64, 'a'), 10, "own", "0.1.0", std::string(64, 'b')};

std::vector<ArchivedFile> frames(std::uint64_t count) {
    std::vector<ArchivedFile> all;
    for (std::uint64_t k = 1; k <= count; ++k) {
        std::string name = std::to_string(k);
        name.insert(0, 12 - name.size(), '0');
        all.push_back({k, name + "-p.png", 1000 + k});
    }
    return all;
}

std::string line_of(const ArchivedFile& frame) {
    if (frame.number % 7 == 0) return unreadable_line(frame.file.string(), ErrorCode::unreadable);
    return "{\"frame\":\"" + frame.file.string() + "\",\"part\":1,\"changes\":[" +
        (frame.number % 5 == 0 ? "\"verdict\"" : "") + "]}";
}

void write_shard(const fs::path& file, ReplayIdentity identity, const Shard& shard,
                 const std::vector<ArchivedFile>& all) {
    identity.frames = all.size();
    auto writer = ShardWriter::create(file, identity, shard);
    ASSERT_TRUE(writer) << writer.error().message();
    for (const ArchivedFile& frame : all) {
        if (shard.holds(frame)) {
            ASSERT_TRUE(writer->add(line_of(frame)));
        }
    }
    ASSERT_TRUE(writer->finish());
}

std::vector<fs::path> write_shards(const fs::path& folder, std::uint64_t count, const std::vector<ArchivedFile>& all) {
    std::vector<fs::path> files;
    for (std::uint64_t k = 1; k <= count; ++k) {
        files.push_back(folder / ("s" + std::to_string(k)));
        write_shard(files.back(), kReplay, {k, count}, all);
    }
    return files;
}

std::string refusal(const std::vector<fs::path>& files, const fs::path& out) {
    const auto merged = merge_shards(files, out);
    EXPECT_FALSE(fs::exists(out));
    return merged ? "merged" : merged.error().message();
}

TEST(Shards, of_any_number_in_any_order_are_the_bytes_of_one_replay) {
    const TempFolder folder;
    std::mt19937 random(7);
    for (const std::uint64_t frame_count : {0U, 1U, 41U}) {
        const auto all = frames(frame_count);
        write_shard(folder.path() / "one", kReplay, {}, all);
        const std::string one = read_text(folder.path() / "one");
        for (const std::uint64_t count : {1U, 2U, 3U, 41U, 60U}) {
            auto files = write_shards(folder.path(), count, all);
            std::shuffle(files.begin(), files.end(), random);
            const auto merged = merge_shards(files, folder.path() / "merged");
            ASSERT_TRUE(merged) << merged.error().message();
            EXPECT_EQ(read_text(folder.path() / "merged"), one) << count << " shards of " << frame_count;
            EXPECT_EQ(merged->records, frame_count);
        }
    }
    EXPECT_THAT(read_text(folder.path() / "one"),
                HasSubstr("\"records\":41,\"same\":29,\"verdicts\":7,\"unreadable\":5,"));
}

TEST(Shards, hold_every_frame_once_and_the_same_one_whatever_else_there_is) {
    const auto all = frames(100);
    for (const ArchivedFile& frame : all) {
        int holders = 0;
        for (std::uint64_t k = 1; k <= 7; ++k) holders += Shard{k, 7}.holds(frame) ? 1 : 0;
        EXPECT_EQ(holders, 1);
    }
    const ArchivedFile unnumbered{0, "elsewhere/x.png", 1}, copied{0, "copy/x.png", 9};
    for (std::uint64_t k = 1; k <= 7; ++k) EXPECT_EQ((Shard{k, 7}.holds(unnumbered)), (Shard{k, 7}.holds(copied)));
}

TEST(Shards, that_do_not_belong_together_are_refused_by_name) {
    const TempFolder folder;
    const fs::path out = folder.path() / "out";
    const auto all = frames(10);
    const auto files = write_shards(folder.path(), 3, all);
    EXPECT_THAT(refusal({files[0], files[2]}, out), HasSubstr("1 of 3 shards are missing: 2/3"));
    const auto many = write_shards(folder.path(), 12, all);
    EXPECT_THAT(refusal({many[1]}, out),
                HasSubstr("11 of 12 shards are missing: 1/12, 3/12, 4/12, 5/12, 6/12, 7/12, "
                          "8/12, 9/12, 10/12, 11/12 ...: replay them"));
    EXPECT_THAT(refusal({many[0], many[1]}, out), HasSubstr("10/12, 11/12, 12/12: replay them"));
    write_shards(folder.path(), 3, all);
    EXPECT_THAT(refusal({files[0], files[1], files[2], files[1]}, out), HasSubstr("are both shard 2/3"));
    EXPECT_THAT(refusal({files[0], folder.path() / "nowhere"}, out), HasSubstr("nowhere cannot be read"));
    write_text(folder.path() / "foreign", "{\"frame\":\"a\"}\n");
    EXPECT_THAT(refusal({files[0], folder.path() / "foreign"}, out), HasSubstr("foreign is no shard of a replay"));
    EXPECT_THAT(refusal({"/dev/zero"}, out), HasSubstr("is no shard of a replay"));

    const auto odd = [&](auto change) {
        ReplayIdentity other = kReplay;
        change(other);
        write_shard(folder.path() / "odd", other, {2, 3}, all);
        return refusal({files[0], folder.path() / "odd", files[2]}, out);
    };
    EXPECT_THAT(odd([](ReplayIdentity& id) { id.archive = std::string(64, 'c'); }),
                HasSubstr("odd are of different replays: archive " + std::string(16, 'a') + " and " +
                          std::string(16, 'c') + ": replay"));
    EXPECT_THAT(odd([](ReplayIdentity& id) { id.recipe = std::string(64, 'c'); }), HasSubstr("recipe own"));
    EXPECT_THAT(odd([](ReplayIdentity& id) { id.software = "0.2.0"; }), HasSubstr("software 0.1.0 and 0.2.0"));
    EXPECT_THAT(odd([](ReplayIdentity& id) { id.program = std::string(64, 'c'); }), HasSubstr("program"));
    write_shard(folder.path() / "odd", kReplay, {2, 4}, all);
    EXPECT_THAT(refusal({files[0], folder.path() / "odd", files[2]}, out), HasSubstr("shards 1/3 and 2/4"));
    // A complete shard without the frames that it should hold.
    {
        auto writer = ShardWriter::create(folder.path() / "odd", kReplay, {2, 3});
        ASSERT_TRUE(writer);
        ASSERT_TRUE(writer->finish());
    }
    EXPECT_THAT(refusal({files[0], folder.path() / "odd", files[2]}, out),
                HasSubstr("hold 6 frames, and the archive 10"));
}

TEST(Shards, torn_at_any_byte_or_changed_in_any_are_refused) {
    const TempFolder folder;
    const fs::path out = folder.path() / "out", torn = folder.path() / "torn";
    const auto files = write_shards(folder.path(), 2, frames(6));
    const std::string whole = read_text(files[1]);
    for (std::size_t size = 0; size < whole.size(); ++size) {
        write_text(torn, whole.substr(0, size));
        EXPECT_THAT(refusal({files[0], torn}, out), HasSubstr(size > whole.find('\n') ? "is torn" : "is no shard"))
            << size;
    }
    for (std::size_t at = 0; at < whole.size(); ++at) {
        std::string changed = whole;
        changed[at] = static_cast<char>(changed[at] ^ 1);
        write_text(torn, changed);
        EXPECT_NE(refusal({files[0], torn}, out), "merged") << at;
    }
    write_text(torn, whole + "\n");
    EXPECT_THAT(refusal({files[0], torn}, out), HasSubstr("something follows"));
}

TEST(Shards, say_how_they_are_torn_and_whether_other_software_wrote_them) {
    const TempFolder folder;
    const fs::path file = folder.path() / "s", out = folder.path() / "out";
    write_shard(file, kReplay, {}, frames(3));
    const std::string whole = read_text(file);
    const std::size_t last = whole.rfind('\n', whole.size() - 2) + 1;
    write_text(file, whole.substr(0, last));
    EXPECT_THAT(refusal({file}, out), HasSubstr("its end is missing"));
    write_text(file, whole.substr(0, last - 2));
    EXPECT_THAT(refusal({file}, out), HasSubstr("its last line is cut off"));
    write_text(file, whole + "{}\n");
    EXPECT_THAT(refusal({file}, out), HasSubstr("something follows its end"));
    std::string newer = whole;
    newer.replace(newer.find("\"hord_replay\":1"), 15, "\"hord_replay\":2");
    write_text(file, newer);
    EXPECT_THAT(refusal({file}, out), HasSubstr("was written by other software"));
    for (const char* number : {"-1", "2.5", "1e99", "18446744073709551616"}) {
        std::string other = whole;
        other.replace(other.find("\"frames\":") + 9, 1, number);
        write_text(file, other);
        EXPECT_THAT(refusal({file}, out), HasSubstr("is no shard of a replay")) << number;
    }
}

TEST(Shards, know_names_with_quotes_and_backslashes) {
    const TempFolder folder;
    std::vector<ArchivedFile> all{{0, "a\\\"b.png", 1}, {0, "a\\\"c.png", 1}, {0, "a\\\\.png", 1}};
    ASSERT_TRUE(put_in_order(all));
    ReplayIdentity identity = kReplay;
    identity.frames = all.size();
    auto writer = ShardWriter::create(folder.path() / "s", identity, {});
    ASSERT_TRUE(writer);
    for (const ArchivedFile& frame : all)
        ASSERT_TRUE(writer->add("{\"frame\":\"" + written_name(frame) + "\",\"part\":1,\"changes\":[]}"));
    ASSERT_TRUE(writer->finish());
    const auto merged = merge_shards({folder.path() / "s"}, folder.path() / "out");
    ASSERT_TRUE(merged) << merged.error().message();
    EXPECT_EQ(merged->records, 3U);
}

TEST(Shards, whose_frames_are_out_of_order_or_there_twice_are_refused) {
    const TempFolder folder;
    const auto all = frames(3);
    for (const auto& order : {std::array{1, 0, 2}, std::array{0, 1, 1}, std::array{0, 2, 1}}) {
        ReplayIdentity identity = kReplay;
        identity.frames = 3;
        auto writer = ShardWriter::create(folder.path() / "odd", identity, {});
        ASSERT_TRUE(writer);
        for (const int k : order) ASSERT_TRUE(writer->add(line_of(all.at(static_cast<std::size_t>(k)))));
        ASSERT_TRUE(writer->finish());
        EXPECT_THAT(refusal({folder.path() / "odd"}, folder.path() / "out"), HasSubstr("a line is out of place"));
    }
}

TEST(Shards, that_hold_the_same_frame_are_refused) {
    const TempFolder folder;
    const auto all = frames(3);
    const auto files = write_shards(folder.path(), 2, all);  // the first holds 1 and 3
    ReplayIdentity identity = kReplay;
    identity.frames = 3;
    {
        auto writer = ShardWriter::create(files[1], identity, {2, 2});
        ASSERT_TRUE(writer);
        for (const ArchivedFile& frame : all) ASSERT_TRUE(writer->add(line_of(frame)));
        ASSERT_TRUE(writer->finish());
    }
    EXPECT_THAT(refusal(files, folder.path() / "out"), HasSubstr("which another shard holds, too"));
}

TEST(Shards, are_merged_into_no_folder_that_is_not_there) {
    const TempFolder folder;
    const auto merged = merge_shards(write_shards(folder.path(), 1, frames(3)), folder.path() / "no" / "out");
    ASSERT_FALSE(merged);
    EXPECT_THAT(merged.error().message(), HasSubstr("no/out cannot be written"));
    EXPECT_EQ(merge_shards({}, folder.path() / "out").error().what, "there is nothing to merge");
}

TEST(Shards, with_a_line_that_does_not_end_are_refused_before_it_is_read) {
    const TempFolder folder;
    const fs::path out = folder.path() / "out", endless = folder.path() / "endless";
    const auto files = write_shards(folder.path(), 2, frames(6));
    constexpr std::uintmax_t kBytes = 64U << 20U;  // of zeros, which take no room on the disk
    const auto refused = [&](const std::string& beginning) {
        write_text(endless, beginning);
        fs::resize_file(endless, kBytes);
        return refusal({files[0], endless}, out);
    };
    const std::string whole = read_text(files[1]);
    EXPECT_THAT(refused(whole.substr(0, whole.find('\n') + 1)),
                HasSubstr("endless is torn or was changed: a line is longer than 16 MB"));
    EXPECT_THAT(refused(whole.substr(0, whole.find('\n'))), HasSubstr("endless is no shard of a replay"));
}

TEST(Shards, of_a_worker_that_is_killed_do_not_appear_and_come_out_the_same_the_second_time) {
    const TempFolder folder;
    const auto all = frames(20);
    write_shard(folder.path() / "one", kReplay, {}, all);
    auto files = write_shards(folder.path(), 2, all);
    fs::remove(files[1]);
    int ready[2];
    ASSERT_EQ(pipe(ready), 0);
    const pid_t worker = fork();
    if (worker == 0) {
        ReplayIdentity identity = kReplay;
        identity.frames = all.size();
        auto writer = ShardWriter::create(files[1], identity, {2, 2});
        for (std::size_t k = 0; k < 10; ++k) {
            if (Shard{2, 2}.holds(all[k])) (void)writer->add(line_of(all[k]));
        }
        if (::write(ready[1], "x", 1) != 1) _exit(1);
        while (true) pause();
    }
    char sign = 0;
    ASSERT_EQ(::read(ready[0], &sign, 1), 1);
    kill(worker, SIGKILL);
    int status = 0;
    waitpid(worker, &status, 0);
    close(ready[0]);
    close(ready[1]);
    ASSERT_TRUE(WIFSIGNALED(status));
    EXPECT_FALSE(fs::exists(files[1]));
    EXPECT_THAT(refusal(files, folder.path() / "merged"), HasSubstr("s2 cannot be read"));
    write_shard(files[1], kReplay, {2, 2}, all);
    ASSERT_TRUE(merge_shards(files, folder.path() / "merged"));
    EXPECT_EQ(read_text(folder.path() / "merged"), read_text(folder.path() / "one"));
}

TEST(Shards, may_be_more_than_the_files_that_a_process_may_open_at_first) {
    const TempFolder folder;
    const auto files = write_shards(folder.path(), 24, frames(24));
    rlimit before{};
    ASSERT_EQ(::getrlimit(RLIMIT_NOFILE, &before), 0);
    rlimit few = before;
    few.rlim_cur = 16;
    ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &few), 0);
    const auto merged = merge_shards(files, folder.path() / "merged");
    EXPECT_EQ(::setrlimit(RLIMIT_NOFILE, &before), 0);
    EXPECT_TRUE(merged) << merged.error().message();
}

TEST(Shards, know_the_archive_by_the_names_and_sizes_of_its_frames) {
    const std::string known = archive_identity(frames(3));
    EXPECT_EQ(archive_identity(frames(3)), known);
    EXPECT_NE(archive_identity(frames(2)), known);
    auto others = frames(3);
    ++others[1].bytes;
    EXPECT_NE(archive_identity(others), known);
    others = frames(3);
    others[1].file = "000000000002-r.png";
    EXPECT_NE(archive_identity(others), known);
}

TEST(Shards, are_named_as_one_of_how_many_and_not_otherwise) {
    EXPECT_EQ(parse_shard("2/4"), (Shard{2, 4}));
    EXPECT_EQ(parse_shard("100000/100000"), (Shard{100'000, 100'000}));
    for (const char* wrong : {"", "/", "1", "1/", "/4", "0/4", "5/4", "1/0", "-1/4", "+1/4", " 1/4", "1/4 ", "1/4/4",
                              "1/4x", "a/b", "1/100001", "18446744073709551617/2", "1/18446744073709551617"}) {
        const auto shard = parse_shard(wrong);
        ASSERT_FALSE(shard) << wrong;
        EXPECT_THAT(shard.error().message(), HasSubstr("shard")) << wrong;
        EXPECT_FALSE(shard.error().cure.empty()) << wrong;
    }
}

TEST(Shards, that_do_not_exist_are_refused_with_those_that_do) {
    EXPECT_EQ(parse_shard("2/1").error().cure, "they are 1/1 to 1/1");
    EXPECT_EQ(parse_shard("1/0").error().cure, "write 1/4, 2/4, 3/4, 4/4");
}

TEST(Shards, name_the_program_by_the_digest_of_its_file) {
    EXPECT_EQ(program_identity().value(), text_identity(read_text("/proc/self/exe")));
}

TEST(Shards, cannot_be_written_where_there_is_no_folder) {
    const auto writer = ShardWriter::create("/nowhere/x.jsonl", kReplay, {});
    ASSERT_FALSE(writer);
    EXPECT_THAT(writer.error().message(), HasSubstr("/nowhere/x.jsonl cannot be written"));
}

}  // namespace
}  // namespace hord::firmware::store::test
