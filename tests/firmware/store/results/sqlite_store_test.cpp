#include <fstream>

#include <sys/stat.h>

#include "tests/firmware/store/results/samples.h"
#include "tests/firmware/store/results/sql.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

std::vector<std::string> whats(const std::vector<StoredChange>& changes) {
    std::vector<std::string> all;
    for (const StoredChange& change : changes) all.push_back(change.what);
    return all;
}

TEST(SqliteStore, gives_back_every_part_as_it_was_written) {
    const TempFolder folder;
    write(folder, Story().add(recipe("lens", "name = \"lens\"")).add(result(1)).add(result(2, PartVerdict::reject)));
    const auto all = results(folder);
    ASSERT_THAT(all, SizeIs(2));
    const StoredResult& r = all[1];
    EXPECT_EQ(r.number, 2);
    EXPECT_EQ(r.boot, 7U);
    EXPECT_EQ(r.sequence, 2U);
    EXPECT_EQ(r.part, 102U);
    EXPECT_EQ(r.time_us, kNoon + 200'000);
    EXPECT_EQ(r.verdict, "reject");
    EXPECT_EQ(r.reason, "neighbours-disagree");
    EXPECT_EQ(r.reject, "confirmed");
    EXPECT_EQ(static_cast<float>(r.score.value()), 0.2F);
    EXPECT_EQ(r.defect_count, 2);
    EXPECT_EQ(
        r.defects,
        R"([{"m":12.25,"n":3.5,"area":9,"peak":1.7,"kind":"scratch"},{"m":40,"n":41,"area":4,"peak":1.1,"kind":"absorbing"}])");
    EXPECT_EQ(r.latency_us, 4202);
    EXPECT_EQ(r.reject_latency_us, 400'000);
    EXPECT_EQ(r.recipe, "lens");
    EXPECT_EQ(r.software, "0.1.0");
    EXPECT_EQ(all[0].defects, "[]");
}

// Its layout cannot be changed later, and without it removed rows give no space back.
TEST(SqliteStore, begins_a_file_that_can_shrink_step_by_step) {
    const TempFolder folder;
    write(folder, Story().add(result(1)));
    EXPECT_EQ(sql_integer(folder, "PRAGMA auto_vacuum"), 2U) << "INCREMENTAL";
}

TEST(SqliteStore, keeps_so_many_defects_and_says_how_many_there_were) {
    const TempFolder folder;
    ResultRecord record = result(1, PartVerdict::reject);
    record.defects.assign(1000, {1.5F, 2.5F, 3, 4.5F, algo::DefectKind::unknown});
    record.result.defects = 1000;
    write(folder, Story().add(record));
    const StoredResult r = results(folder).at(0);
    EXPECT_EQ(r.defect_count, 1000);
    EXPECT_EQ(std::count(r.defects.begin(), r.defects.end(), '{'), 64);
    EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
}

TEST(SqliteStore, continues_its_numbers_over_restarts_and_names_each_run) {
    const TempFolder folder;
    write(folder, Story(start(7)).add_results(1, 20));
    write(folder, Story(start(8)).add_results(1, 5));
    const auto all = results(folder);
    ASSERT_THAT(all, SizeIs(25));
    for (std::size_t k = 0; k < all.size(); ++k) EXPECT_EQ(all[k].number, static_cast<std::int64_t>(k + 1));
    EXPECT_EQ(all[19].boot, 7U);
    EXPECT_EQ(all[20].boot, 8U);
    EXPECT_EQ(all[20].sequence, 1U);  // the sequence begins again with the next boot
    EXPECT_NE(all[19].run, all[20].run);
    EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
}

TEST(SqliteStore, stores_a_repeated_batch_once) {
    const TempFolder folder;
    Story run;
    run.add(recipe("a", "1"))
        .add_results(1, 10)
        .add(ChangeRecord{ChangeRecord::What::command, kNoon, "plc:1", 9, "stop", "Ready", "done"});
    write(folder, run);
    write(folder, run);  // written again, as after an error that left the batch in doubt
    run.add_results(11, 12);
    write(folder, run);
    EXPECT_THAT(results(folder), SizeIs(12));
    EXPECT_THAT(whats(changes(folder)), ElementsAre("start", "recipe", "command"));
    EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
}

TEST(SqliteStore, does_not_go_back_to_an_older_recipe_when_it_is_opened_again) {
    const TempFolder folder;
    Story run;
    run.add(recipe("a", "1")).add(result(1)).add(recipe("b", "2")).add(result(2));
    write(folder, run);
    // The entries of a queue that had written the first two records and then saw an error.
    const auto store = open(folder);
    ASSERT_TRUE(store->write(std::vector<Entry>{{0, start()}, {0, recipe("a", "1")}}));
    ASSERT_TRUE(store->write(std::vector<Entry>{{3, recipe("b", "2")}, {4, result(2)}, {5, result(3)}}));
    const auto all = results(folder);
    ASSERT_THAT(all, SizeIs(3));
    EXPECT_EQ(all[1].recipe, "b");
    EXPECT_EQ(all[2].recipe, "b");
}

TEST(SqliteStore, tells_a_fresh_file_what_is_in_use_and_a_known_one_only_what_is_new) {
    const TempFolder folder;
    ChangeRecord at_start = recipe("a", "1");
    at_start.if_new = true;
    write(folder, Story(start(7)).add(at_start).add(result(1)));
    write(folder, Story(start(8)).add(at_start).add(result(1)));
    at_start.after = "2";
    write(folder, Story(start(9)).add(at_start).add(result(1)));
    const auto all = changes(folder);
    EXPECT_THAT(whats(all), ElementsAre("start", "recipe", "start", "start", "recipe"));
    EXPECT_EQ(all[4].before, "1");
    EXPECT_EQ(all[4].after, "2");
    const auto parts = results(folder);
    EXPECT_EQ(parts[0].recipe_change, parts[1].recipe_change);
    EXPECT_NE(parts[1].recipe_change, parts[2].recipe_change);
}

TEST(SqliteStore, records_an_empty_text_that_is_in_use_once) {
    const TempFolder folder;
    ChangeRecord empty = recipe("none", "");
    empty.if_new = true;
    for (const std::uint32_t boot : {4'294'967'294U, 4'294'967'295U})
        write(folder, Story(start(boot)).add(empty).add(result(1)));
    EXPECT_THAT(whats(changes(folder)), ElementsAre("start", "recipe", "start"));
    EXPECT_EQ(results(folder).at(0).boot, 4'294'967'294U);
    EXPECT_EQ(results(folder).at(1).boot, 4'294'967'295U);
    EXPECT_EQ(results(folder).at(1).recipe, "none");
}

TEST(SqliteStore, records_who_changed_what_from_what) {
    const TempFolder folder;
    ChangeRecord change = recipe("lens", "limit = 2");
    change.before = "limit = 1";
    change.peer = "192.0.2.7:50123";
    change.token = 71;
    write(folder,
          Story().add(change).add(ChangeRecord{ChangeRecord::What::command, kNoon + 5, "192.0.2.7:50123", 72,
                                               "start-continuous", "Ready", "completed"}));
    const auto all = changes(folder);
    ASSERT_THAT(all, SizeIs(3));
    EXPECT_EQ(all[1].peer, "192.0.2.7:50123");
    EXPECT_EQ(all[1].token, 71U);
    EXPECT_EQ(all[1].before, "limit = 1");
    EXPECT_EQ(all[1].after, "limit = 2");
    EXPECT_EQ(all[2].what, "command");
    EXPECT_EQ(all[2].name, "start-continuous");
}

TEST(SqliteStore, filters_by_time_verdict_kind_recipe_and_takes_the_newest) {
    const TempFolder folder;
    ResultRecord bubble = result(31, PartVerdict::reject);
    bubble.defects = {{1, 1, 1, 1, algo::DefectKind::scattering}};
    write(folder,
          Story().add(recipe("a", "1")).add_results(1, 20).add(recipe("b", "2")).add_results(21, 30).add(bubble));
    ResultFilter filter;
    filter.verdict = "reject";
    EXPECT_THAT(results(folder, filter), SizeIs(4));
    filter.kind = "scratch";
    EXPECT_THAT(results(folder, filter), SizeIs(3));
    filter.recipe = "b";
    EXPECT_EQ(results(folder, filter).at(0).sequence, 30U);
    filter = {};
    filter.reason = "neighbours-disagree";
    filter.since = kNoon + 2'000'000;
    EXPECT_THAT(results(folder, filter), SizeIs(3));
    filter.until = kNoon + 3'000'000;
    EXPECT_THAT(results(folder, filter), SizeIs(1));
    filter = {};
    filter.newest = 3;
    const auto newest = results(folder, filter);
    ASSERT_THAT(newest, SizeIs(3));
    EXPECT_EQ(newest.front().sequence, 29U);
    EXPECT_EQ(newest.back().sequence, 31U);
    filter.recipe = "none of these'; DROP TABLE results; --";
    EXPECT_THAT(results(folder, filter), IsEmpty());
}

TEST(SqliteStore, reads_and_filters_reasons_by_their_present_and_former_names) {
    const TempFolder folder;
    write(folder, Story().add_results(1, 40));
    const auto found = [&](const char* reason) {
        ResultFilter filter;
        filter.reason = reason;
        return results(folder, filter);
    };
    const std::size_t before = found("neighbours-disagree").size();
    ASSERT_GE(before, 2U);
    sql(folder, "UPDATE results SET reason = 'deflection' WHERE reason = 'neighbours-disagree' AND number < 20");
    sql(folder, "UPDATE results SET reason = 'slope' WHERE reason = 'none'");
    EXPECT_THAT(found("neighbours-disagree"), SizeIs(before));
    EXPECT_THAT(found("deflection"), SizeIs(before));
    EXPECT_THAT(found("none"), IsEmpty());
    ASSERT_FALSE(found("deflection-gradient").empty());
    EXPECT_EQ(found("slope").front().reason, "deflection-gradient");
}

// -- unusable stores

TEST(SqliteStore, belongs_to_one_writer_while_anybody_may_read) {
    const TempFolder folder;
    const auto store = open(folder);
    ASSERT_TRUE(store->write(Story().add(result(1)).entries()));
    const auto second = open_sqlite_store(folder.path());
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, ErrorCode::busy);
    EXPECT_THAT(results(folder), SizeIs(1));
}

TEST(SqliteStore, refuses_what_is_no_store_and_leaves_it_alone) {
    const TempFolder folder;
    const std::string text(5000, 'x');
    write_text(folder.path() / "results.db", text);
    const auto store = open_sqlite_store(folder.path());
    ASSERT_FALSE(store);
    EXPECT_EQ(store.error().code, ErrorCode::unreadable);
    EXPECT_THAT(store.error().message(), HasSubstr("results.db"));
    EXPECT_EQ(read_text(folder.path() / "results.db"), text);
}

TEST(SqliteStore, begins_in_an_empty_file_and_says_so_but_not_where_its_log_has_results) {
    const TempFolder folder;
    const auto file = folder.path() / "results.db", log = folder.path() / "results.db-wal";
    std::vector<std::string> notes;
    SqliteStoreOptions options;
    options.note = [&](const Error& note) { notes.push_back(note.message()); };
    EXPECT_TRUE(open(folder, options));
    EXPECT_TRUE(open(folder, options));
    EXPECT_THAT(notes, IsEmpty()) << "no file, then a store";
    std::filesystem::remove(file);
    write_text(file, "");
    write_text(log, "results");
    const auto refused = open_sqlite_store(folder.path(), options);
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().message(), HasSubstr("results.db is empty, 0 bytes, and its -wal has results"));
    EXPECT_EQ(read_text(log), "results");
    std::filesystem::remove(log);
    EXPECT_THAT(StoreReader::open(folder.path()).error().cure, HasSubstr("start its station"));
    EXPECT_TRUE(open(folder, options));
    EXPECT_THAT(notes, ElementsAre(HasSubstr("results.db was empty, 0 bytes: a new store begins in it")));
    EXPECT_TRUE(StoreReader::open(folder.path()));
}

TEST(SqliteStore, refuses_another_programs_database_and_a_newer_schema) {
    const TempFolder other, newer;
    sql(other, "CREATE TABLE t (a); INSERT INTO t VALUES (1)");
    for (const char* version : {"0", "1", "1000"}) {
        sql(other, std::string("PRAGMA user_version = ") + version);
        EXPECT_EQ(open_sqlite_store(other.path()).error().code, ErrorCode::unreadable) << version;
    }
    write(newer, Story().add(result(1)));
    sql(newer, "PRAGMA user_version = 1000");
    EXPECT_EQ(open_sqlite_store(newer.path()).error().code, ErrorCode::unsupported);
    EXPECT_EQ(StoreReader::open(newer.path()).error().code, ErrorCode::unsupported);
}

TEST(SqliteStore, is_not_opened_without_one_of_its_tables_or_columns) {
    for (const char* edit :
         {"DROP TABLE heads", "DROP TABLE results", "DROP TABLE commands", "DROP TABLE meta",
          "ALTER TABLE commands RENAME COLUMN peer TO who", "ALTER TABLE changes RENAME COLUMN after TO later"}) {
        const TempFolder folder;
        write(folder, Story().add(result(1)));
        sql(folder, edit);
        const auto store = open_sqlite_store(folder.path());
        ASSERT_FALSE(store) << edit;
        EXPECT_EQ(store.error().code, ErrorCode::unsupported) << store.error().message();
    }
}

TEST(SqliteStore, names_the_folder_it_cannot_make) {
    const auto store = open_sqlite_store("/nonexistent/folder/store");
    ASSERT_FALSE(store);
    EXPECT_THAT(store.error().message(), HasSubstr("/nonexistent/folder/store"));
}

TEST(SqliteStore, survives_a_cut_off_or_overwritten_file_with_an_error) {
    for (const int kind : {0, 1}) {
        const TempFolder folder;
        write(folder, Story().add_results(1, 3000));
        const auto file = folder.path() / "results.db";
        const auto size = std::filesystem::file_size(file);
        if (kind == 0) {
            std::filesystem::resize_file(file, size / 2);
        } else {
            std::fstream damage(file, std::ios::in | std::ios::out | std::ios::binary);
            damage.seekp(static_cast<std::streamoff>(size / 4));
            damage << std::string(size / 2, '\x55');
        }
        EXPECT_FALSE(verify(folder.path()).problems.empty());
        auto store = open_sqlite_store(folder.path());
        if (!store) {
            EXPECT_EQ(store.error().code, ErrorCode::unreadable) << store.error().message();
            continue;
        }
        const auto done = (*store)->write(Story(start(9)).add_results(1, 100).entries());
        EXPECT_TRUE(done || done.error().code == ErrorCode::unreadable) << done.error().message();
    }
}

// Two runs: results 1 to 5 of boot 7, 6 to 10 of boot 8.
TEST(SqliteStore, filters_by_number_run_boot_and_part) {
    const TempFolder folder;
    write(folder, Story(start(7)).add_results(1, 5));
    write(folder, Story(start(8)).add_results(1, 5));
    const auto numbers = [&](const ResultFilter& filter) {
        std::vector<std::int64_t> all;
        for (const StoredResult& r : results(folder, filter)) all.push_back(r.number);
        return all;
    };
    ResultFilter by;
    by.number = 4;
    EXPECT_THAT(numbers(by), ElementsAre(4));
    by = {};
    by.before = 4;
    EXPECT_THAT(numbers(by), ElementsAre(1, 2, 3));
    by.newest = 2;
    EXPECT_THAT(numbers(by), ElementsAre(2, 3));
    by = {};
    by.after = 8;
    EXPECT_THAT(numbers(by), ElementsAre(9, 10));
    by.after = 3;
    by.oldest = 2;
    EXPECT_THAT(numbers(by), ElementsAre(4, 5));
    by = {};
    by.boot = 8;
    EXPECT_THAT(numbers(by), ElementsAre(6, 7, 8, 9, 10));
    by.part = 102;
    EXPECT_THAT(numbers(by), ElementsAre(7));
    by.boot = 9;
    EXPECT_THAT(numbers(by), IsEmpty());
    by = {};
    by.run = results(folder).front().run;
    EXPECT_THAT(numbers(by), ElementsAre(1, 2, 3, 4, 5));
    EXPECT_EQ(changes(folder, by).size(), 1U);
    by = {};
    by.since = kNoon + 200'000;
    by.until = kNoon + 300'000;
    EXPECT_THAT(numbers(by), ElementsAre(2, 7)) << "the first moment counts, the last does not";
    by = {};
    by.newest = 1;
    EXPECT_EQ(changes(folder, by).at(0).after, changes(folder).at(1).after);
}

TEST(SqliteStore, lists_changes_and_commands_in_the_order_in_which_they_came) {
    const TempFolder folder;
    const auto command = [](const char* name, UtcMicros time_us) {
        return ChangeRecord{ChangeRecord::What::command, time_us, "plc:1", 1, name, "", ""};
    };
    write(folder, Story(start(7)).add(command("arm", kNoon)).add(recipe("a", "1")).add(command("stop", kNoon)));
    write(folder, Story(start(8)).add(command("early", kNoon - 1)).add(recipe("b", "2")));
    const auto names = [&](const ResultFilter& filter) {
        std::vector<std::string> all;
        for (const StoredChange& change : changes(folder, filter)) all.push_back(change.name);
        return all;
    };
    ResultFilter filter;
    EXPECT_THAT(names(filter), ElementsAre("early", "cell 3", "arm", "a", "stop", "cell 3", "b"));
    filter.newest = 3;
    EXPECT_THAT(names(filter), ElementsAre("stop", "cell 3", "b"));
    filter = {};
    filter.what = "command";
    EXPECT_THAT(names(filter), ElementsAre("early", "arm", "stop"));
    filter.until = kNoon;
    EXPECT_THAT(names(filter), ElementsAre("early"));
    filter = {};
    filter.run = changes(folder).back().run;
    EXPECT_THAT(names(filter), ElementsAre("early", "cell 3", "b"));
}

// 0 would be the number of no change, and a reader of the file could not tell it from one.
TEST(SqliteStore, refers_to_the_changes_in_use_and_to_none_where_there_is_none) {
    const TempFolder folder;
    ChangeRecord calibration = recipe("grid", "3");
    calibration.what = ChangeRecord::What::calibration;
    write(folder, Story().add(result(1)).add(recipe("a", "1")).add(result(2)).add(calibration).add(result(3)));
    const auto count = [&](const char* where) {
        return sql_integer(folder, std::string("SELECT count(*) FROM results WHERE ") + where);
    };
    EXPECT_EQ(count("number = 1 AND recipe IS NULL AND calibration IS NULL"), 1U);
    EXPECT_EQ(count("number = 2 AND recipe = 2 AND calibration IS NULL"), 1U);
    EXPECT_EQ(count("number = 3 AND recipe = 2 AND calibration = 3"), 1U);
    EXPECT_EQ(results(folder).at(2).calibration, "grid");
}

TEST(SqliteStore, has_an_identity_of_its_own_that_stays) {
    const TempFolder folder, other;
    write(folder, Story().add(result(1)));
    write(other, Story().add(result(1)));
    const std::string id = StoreReader::open(folder.path()).value()->id();
    EXPECT_THAT(id, ::testing::MatchesRegex("[0-9a-f]+"));
    EXPECT_EQ(id.size(), 32U);
    write(folder, Story(start(8)));
    EXPECT_EQ(StoreReader::open(folder.path()).value()->id(), id);
    EXPECT_NE(StoreReader::open(other.path()).value()->id(), id);
}

TEST(SqliteStore, ends_a_read_that_takes_too_long) {
    const TempFolder folder;
    write(folder, Story().add_results(1, 20'000));
    const auto reader = std::move(*StoreReader::open(folder.path()));
    reader->limit_time(std::chrono::milliseconds(0));
    const auto ended = reader->each_result({}, [](const StoredResult&) {});
    ASSERT_FALSE(ended);
    EXPECT_EQ(ended.error().code, ErrorCode::timeout);
    reader->limit_time(std::chrono::hours(1));
    EXPECT_TRUE(reader->each_result({}, [](const StoredResult&) {}));
}

TEST(SqliteStore, says_its_newest_number_and_what_is_in_a_part_that_nobody_rejected) {
    const TempFolder folder;
    write(folder, Story(start(7)));
    EXPECT_EQ(StoreReader::open(folder.path()).value()->newest_number().value(), 0);
    write(folder, Story(start(8)).add_results(1, 3));
    EXPECT_EQ(StoreReader::open(folder.path()).value()->newest_number().value(), 3);
    const StoredResult first = results(folder).at(0);
    EXPECT_EQ(first.recipe + first.calibration, "");
    EXPECT_EQ(first.recipe_change, 0);
    EXPECT_EQ(first.reject_latency_us, 0);
    EXPECT_EQ(first.bounded, std::optional(false));
    EXPECT_EQ(results(folder).at(1).bounded, std::optional(true));
    write_text(folder.path() / "results.db", "");
    const auto empty = StoreReader::open(folder.path());
    ASSERT_FALSE(empty);
    EXPECT_THAT(empty.error().what, HasSubstr("is empty"));
}

}  // namespace
}  // namespace hord::firmware::store::test
