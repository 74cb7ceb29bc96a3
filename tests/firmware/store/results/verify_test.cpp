// Every kind of tampering that the hash chain promises to find, each done with plain SQL.
#include "tests/firmware/store/results/samples.h"
#include "tests/firmware/store/results/sql.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

// Two runs, two recipes, commands, and a prefix that retention has removed: results 101 to 340 are left.
void fill(const TempFolder& folder) {
    Calendar calendar;
    const Retention a_day{.keep_days = 1, .max_bytes = 0};
    Story first;
    first.add(recipe("a", "1")).add_results(1, 100);
    for (std::uint32_t k = 1; k <= 20; ++k)
        first.add(ChangeRecord{ChangeRecord::What::command, kNoon + k, "plc:1", k, "stop", "Ready", "completed"});
    {
        const auto store = open(folder);
        ASSERT_TRUE(store->write(first.entries()));
        ASSERT_TRUE(calendar.live(*store, a_day, 1));
        ASSERT_TRUE(store->write(first.add_results(101, 200).entries()));
    }
    const auto store = open(folder);
    ASSERT_TRUE(store->write(Story(start(8)).add(recipe("b", "2")).add_results(1, 140).entries()));
    ASSERT_TRUE(calendar.live(*store, a_day, 10));
}

struct Tampering {
    const char* name;
    const char* sql;
    const char* told;  // part of a problem's text
};

class EveryTampering : public ::testing::TestWithParam<Tampering> {};

TEST_P(EveryTampering, is_found) {
    const TempFolder folder;
    fill(folder);
    ASSERT_THAT(verify(folder.path()).problems, IsEmpty());
    // A new store refuses a value of another type; one of before does not.
    if (std::string_view(GetParam().name) == "type_edited") loosen(folder);
    sql(folder, GetParam().sql);
    const auto problems = verify(folder.path()).problems;
    EXPECT_THAT(problems, Contains(HasSubstr(GetParam().told))) << ::testing::PrintToString(problems);
}

INSTANTIATE_TEST_SUITE_P(
    Verify, EveryTampering,
    ::testing::Values(
        Tampering{"verdict_edited", "UPDATE results SET verdict = 'pass', reason = 'none' WHERE number = 120",
                  "results: row 120 is not as it was written"},
        Tampering{"score_edited_in_the_last_bit", "UPDATE results SET score = score + 1e-15 WHERE number = 130",
                  "results: row 130 is not as"},
        Tampering{"defects_edited", "UPDATE results SET defects = '[]' WHERE number = 120",
                  "results: row 120 is not as"},
        Tampering{"time_edited", "UPDATE results SET time_us = time_us - 1 WHERE number = 121",
                  "results: row 121 is not as"},
        Tampering{"type_edited", "UPDATE results SET reason = CAST(reason AS BLOB) WHERE number = 121",
                  "results: row 121 is not as"},
        Tampering{"number_turned_to_null", "UPDATE results SET recipe = NULL WHERE number = 121",
                  "results: row 121 is not as"},
        Tampering{"version_edited", "UPDATE results SET v = 99 WHERE number = 121", "results: row 121 is not as"},
        Tampering{"hash_edited", "UPDATE results SET hash = zeroblob(32) WHERE number = 150",
                  "results: row 150 is not as"},
        Tampering{"row_removed", "DELETE FROM results WHERE number = 200", "results: row 200 is missing"},
        Tampering{"rows_removed", "DELETE FROM results WHERE number BETWEEN 200 AND 210",
                  "results: rows 200 to 210 are missing"},
        Tampering{"first_rows_removed_as_retention_would", "DELETE FROM results WHERE number <= 150",
                  "results: rows 101 to 150 are missing"},
        Tampering{"last_rows_removed", "DELETE FROM results WHERE number > 330",
                  "results: rows 331 to 340 are missing at the end"},
        Tampering{"all_rows_removed", "DELETE FROM results", "results: rows 101 to 340 are missing at the end"},
        Tampering{"row_removed_and_later_ones_renumbered",
                  "DELETE FROM results WHERE number = 200; UPDATE results SET number = -number WHERE number > 200; "
                  "UPDATE results SET number = -number - 1 WHERE number < 0; UPDATE heads SET number = 339 WHERE chain "
                  "= 'results'",
                  "results: row 200 is not as"},
        Tampering{"row_appended",
                  "INSERT INTO results SELECT 341, v, run, entry, time_us, sequence, part, verdict, reason, score, "
                  "defect_count, defects, latency_us, "
                  "reject_latency_us, reject, recipe, calibration, hash, bounded FROM results WHERE number = 340",
                  "results: row 341 was inserted at the end"},
        Tampering{"row_appended_with_its_head",
                  "INSERT INTO results SELECT 341, v, run, entry, time_us, sequence, part, verdict, reason, score, "
                  "defect_count, defects, latency_us, "
                  "reject_latency_us, reject, recipe, calibration, hash, bounded FROM results WHERE number = 340; "
                  "UPDATE heads "
                  "SET number = 341 WHERE chain = 'results'",
                  "results: row 341 is not as"},
        Tampering{"row_inserted_before_the_first",
                  "INSERT INTO results SELECT 100, v, run, entry, time_us, sequence, part, verdict, reason, score, "
                  "defect_count, defects, latency_us, "
                  "reject_latency_us, reject, recipe, calibration, hash, bounded FROM results WHERE number = 101",
                  "results: row 100"},
        Tampering{
            "rows_exchanged",
            "UPDATE results SET number = -1 WHERE number = 120; UPDATE results SET number = 120 WHERE number = 121; "
            "UPDATE results SET number = 121 WHERE number = -1",
            "results: row 120 is not as"},
        Tampering{"head_edited", "UPDATE heads SET hash = zeroblob(32) WHERE chain = 'results'",
                  "results: row 340 is not the one that was written last"},
        Tampering{"head_removed", "DELETE FROM heads WHERE chain = 'results'",
                  "results: rows 1 to 340 were inserted at the end"},
        Tampering{"recipe_text_edited", "UPDATE changes SET after = '3' WHERE what = 'recipe' AND name = 'a'",
                  "changes: row 2 is not as"},
        Tampering{"who_edited", "UPDATE commands SET peer = 'plc:2' WHERE number = 20", "commands: row 20 is not as"},
        Tampering{"command_removed", "DELETE FROM commands WHERE number = 20",
                  "commands: row 20 is missing at the end"},
        Tampering{"retention_edited_to_hide_removed_rows",
                  "UPDATE changes SET after = replace(after, '\"to\":100', '\"to\":150') WHERE what = 'retention' AND "
                  "name = 'results'; DELETE FROM results WHERE number <= 150",
                  "changes: row"},
        Tampering{"retention_removed", "DELETE FROM changes WHERE what = 'retention'",
                  "results: rows 1 to 100 are missing"},
        Tampering{"retention_garbled", "UPDATE changes SET after = 'x' WHERE what = 'retention'",
                  "results: what retention removed cannot be read"},
        Tampering{"store_renamed", "UPDATE meta SET value = 'another' WHERE key = 'id'", "changes: row 1 is not as"}),
    [](const auto& test) { return std::string(test.param.name); });

TEST(Verify, reports_one_edited_row_as_one_problem) {
    const TempFolder folder;
    fill(folder);
    sql(folder, "UPDATE results SET verdict = 'pass' WHERE number = 120");
    EXPECT_THAT(verify(folder.path()).problems, ElementsAre("results: row 120 is not as it was written"));
}

TEST(Verify, names_a_hundred_problems_of_a_chain_and_counts_the_others) {
    for (const int edited : {100, 103}) {
        const TempFolder folder;
        write(folder, Story().add_results(1, 120));
        sql(folder, "UPDATE results SET verdict = 'unfit' WHERE number <= " + std::to_string(edited));
        const auto problems = verify(folder.path()).problems;
        ASSERT_THAT(problems, ::testing::SizeIs(edited == 100 ? 100 : 101));
        EXPECT_EQ(problems[99], "results: row 100 is not as it was written");
        if (edited > 100) {
            EXPECT_EQ(problems[100], "results: 3 further problems");
        }
    }
}

TEST(Verify, finds_another_head_of_a_chain_of_one_row) {
    const TempFolder folder;
    write(folder, Story().add(result(1)));
    sql(folder, "UPDATE heads SET hash = zeroblob(32) WHERE chain = 'results'");
    EXPECT_THAT(verify(folder.path()).problems, ElementsAre("results: row 1 is not the one that was written last"));
}

TEST(Verify, finds_a_row_of_another_store_with_its_hash) {
    const TempFolder folder, other;
    write(folder, Story().add(result(1)));
    write(other, Story().add(result(1)));
    sql(folder,
        "ATTACH '" + (other.path() / "results.db").string() +
            "' AS o; DELETE FROM results; INSERT INTO results SELECT * FROM o.results; "
            "UPDATE heads SET hash = (SELECT hash FROM o.results)");
    EXPECT_THAT(verify(folder.path()).problems, Not(IsEmpty()));
}

// A file with all hashes recomputed is consistent. Only a head noted elsewhere reveals the change.
TEST(Verify, compares_with_heads_that_were_noted_elsewhere) {
    const TempFolder folder, forged;
    write(folder, Story().add_results(1, 50));
    const auto noted = verify(folder.path()).heads;
    ASSERT_EQ(noted.size(), 3U);
    write(folder, Story().add_results(1, 80));
    EXPECT_THAT(verify(folder.path(), noted).problems, IsEmpty());

    Story other;  // the same store, but the tenth part passed
    other.add_results(1, 9).add(result(10)).add_results(11, 80);
    write(forged, Story().add(result(1)));
    sql(forged,
        "DELETE FROM results; DELETE FROM changes; DELETE FROM heads; UPDATE meta SET value = '"
        "id'");
    write(forged, other);
    const auto problems = verify(forged.path(), noted).problems;
    EXPECT_THAT(problems, Contains(HasSubstr("results: row 50 has another hash than was noted")));

    // The store ends before a noted row, as after a cut.
    std::vector<ChainHead> later = noted;
    later.back().number = 81;
    EXPECT_THAT(verify(folder.path(), later).problems,
                ElementsAre("results: row 81, noted before, is missing at the end"));
}

TEST(Verify, accepts_a_noted_head_that_retention_has_removed_since) {
    const TempFolder folder;
    write(folder, Story().add_results(1, 50));
    const auto noted = verify(folder.path()).heads;
    const auto store = open(folder);
    Calendar calendar;
    const Retention a_day{.keep_days = 1, .max_bytes = 0};
    ASSERT_TRUE(store->write(Story().add_results(1, 70).entries()));
    ASSERT_TRUE(calendar.live(*store, a_day, 1));
    ASSERT_TRUE(store->write(Story().add_results(1, 80).entries()));
    ASSERT_TRUE(calendar.live(*store, a_day, 10));
    EXPECT_EQ(results(folder).front().number, 71);
    EXPECT_THAT(verify(folder.path(), noted).problems, IsEmpty());
    ChainHead last_removed;
    last_removed.chain = "results";
    last_removed.number = 70;
    last_removed.hash = std::string(64, 'f');
    EXPECT_THAT(verify(folder.path(), {last_removed}).problems,
                ElementsAre("results: row 70, removed by retention, had another hash than was noted"));
}

TEST(Verify, may_run_while_the_station_writes) {
    const TempFolder folder;
    const auto store = open(folder);
    Story run;
    for (std::uint32_t k = 0; k < 20; ++k) {
        run.add_results(k * 10 + 1, k * 10 + 10);
        ASSERT_TRUE(store->write(run.entries()));
        EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
    }
}

TEST(Verify, of_a_store_that_lacks_a_table_or_a_column_is_an_error_and_no_problem_of_a_row) {
    for (const char* edit : {"DROP TABLE changes", "DROP TABLE heads", "DROP TABLE results", "DROP TABLE commands",
                             "ALTER TABLE heads RENAME COLUMN hash TO sum", "ALTER TABLE results RENAME COLUMN v TO w",
                             "ALTER TABLE changes RENAME COLUMN what TO which"}) {
        const TempFolder folder;
        write(folder, Story().add(result(1)));
        sql(folder, edit);
        const auto reader = std::move(*StoreReader::open(folder.path()));
        for (int again = 0; again < 2; ++again) {
            const auto verified = reader->verify();
            ASSERT_FALSE(verified) << edit;
            EXPECT_EQ(verified.error().code, ErrorCode::unsupported) << edit;
        }
    }
}

TEST(Verify, names_a_head_that_cannot_be_read_and_a_run_that_never_began) {
    const TempFolder folder;
    fill(folder);
    loosen(folder);
    sql(folder, "UPDATE heads SET number = 'x' WHERE chain = 'results'");
    EXPECT_THAT(verify(folder.path()).problems,
                ElementsAre("results: the number of the row that was written last cannot be read"));
    sql(folder,
        "UPDATE heads SET number = 340 WHERE chain = 'results'; UPDATE results SET run = 99 WHERE number = 340");
    EXPECT_THAT(verify(folder.path()).problems,
                Contains("results: row 340 belongs to a run that the changes do not know"));
}

}  // namespace
}  // namespace hord::firmware::store::test
