// Text exports of the station, compared with stored files because external programs read them.
#include "firmware/store/results/export.h"

#include <limits>
#include <map>

#include <fmt/format.h>

#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::store::test {
namespace {

const std::filesystem::path kExpected =
    std::filesystem::path(HORD_SOURCE_DIR) / "tests/firmware/store/results/expected";

void fill(const TempFolder& folder) {
    ChangeRecord change = recipe("lens, \"clear\"", "name = \"lens\"\nlimit = 2\n");
    change.before = "name = \"lens\"\nlimit = 1\n";
    change.peer = "192.0.2.7:50123";
    change.token = 71;
    ResultRecord late = result(3);
    late.result.verdict = PartVerdict::unfit;
    late.result.reason = PartReason::verdict_late;
    late.result.reject = RejectState::failed;
    write(folder,
          Story()
              .add(change)
              .add(result(1))
              .add(result(2, PartVerdict::reject))
              .add(late)
              .add(ChangeRecord{ChangeRecord::What::command, kNoon + kSecond, "192.0.2.7:50123", 72, "start-continuous",
                                "Ready", "completed"}));
}

template <class Row>
std::string json_line(const Row& row) {
    return to_line(to_json(row));
}

template <class Row>
std::string all_of(const std::vector<Row>& rows, std::string text, std::string (*line)(const Row&)) {
    for (const Row& row : rows) text += line(row) + "\n";
    return text;
}

TEST(Export, gives_the_same_bytes_as_ever) {
    const TempFolder folder;
    fill(folder);
    EXPECT_EQ(all_of(results(folder), csv_head_of_results() + "\n", to_csv), read_text(kExpected / "results.csv"));
    EXPECT_EQ(all_of(results(folder), "", json_line), read_text(kExpected / "results.jsonl"));
    EXPECT_EQ(all_of(changes(folder), csv_head_of_changes() + "\n", to_csv), read_text(kExpected / "changes.csv"));
    EXPECT_EQ(all_of(changes(folder), "", json_line), read_text(kExpected / "changes.jsonl"));
}

TEST(Export, tells_of_long_texts_and_of_several_lines_only_their_size) {
    StoredChange change;
    change.before = std::string(60, 'x');
    change.after = std::string(61, 'x');
    EXPECT_THAT(to_table(change), ::testing::EndsWith(change.before + " -> (61 bytes)"));
    change.after = "a\nb";
    EXPECT_THAT(to_table(change), ::testing::EndsWith(change.before + " -> (3 bytes)"));
}

TEST(Export, writes_times_of_any_year_and_what_is_no_time) {
    EXPECT_EQ(format_utc(32'503'680'000 * kSecond + 5000),
              "3000-01-01T00:00:00.005Z");  // beyond a clock of nanoseconds
    EXPECT_EQ(format_utc(-kSecond), "1969-12-31T23:59:59.000Z");
    EXPECT_EQ(format_utc(std::numeric_limits<UtcMicros>::max()), "9223372036854775807 us");
    EXPECT_EQ(format_utc(std::numeric_limits<UtcMicros>::min()), "-9223372036854775808 us");
}

// The number format of every store and archive. nlohmann-json writes other digits for about one value in a thousand.
TEST(Export, floats_keep_the_digits_that_they_were_always_written_with) {
    for (const float value : {0.0F, 0.1F, 0.30000001F, 1.7F, 12.25F, 40.0F, 16777216.0F, 0.0001F, 1.5e-5F, 3e-30F})
        EXPECT_EQ(to_line(Json(value)), fmt::format("{}", value));
    for (float value = 1e-6F; value < 1e6F; value *= 1.000917F)
        EXPECT_EQ(to_line(Json(value)), fmt::format("{}", value));
}

TEST(Export, times_are_read_as_people_write_them) {
    const UtcMicros now = kNoon;
    const auto read = [&](const char* text) { return parse_utc(text, now); };
    EXPECT_EQ(format_utc(*read("2026-11-21")), "2026-11-21T00:00:00.000Z");
    EXPECT_EQ(format_utc(*read("2026-11-21T07:15")), "2026-11-21T07:15:00.000Z");
    EXPECT_EQ(format_utc(*read("2026-11-21T07:15:30Z")), "2026-11-21T07:15:30.000Z");
    EXPECT_EQ(*read("90s"), now - 90 * kSecond);
    EXPECT_EQ(*read("7d"), now - 7 * kDay);
    EXPECT_EQ(*read("0d"), now);
    EXPECT_EQ(*read("1m"), now - 60 * kSecond);
    EXPECT_EQ(*read("2h"), now - 7200 * kSecond);
    EXPECT_EQ(*read("1000000s"), now - 1'000'000 * kSecond);
    EXPECT_FALSE(read("1000001s"));
    EXPECT_EQ(format_utc(-1), "1969-12-31T23:59:59.999Z");
    for (const char* bad : {"", "yesterday", "2026-02-30", "2026-11-21T", "2026-11-21T7", "21.11.2026", "-3d", "3w",
                            "2026-11-21T07:15:30+01:00", "2026-11-21T25:00"}) {
        EXPECT_FALSE(read(bad)) << bad;
    }
}

TEST(Export, a_period_that_ends_before_it_begins_is_refused) {
    EXPECT_TRUE(check_period({}, {}));
    EXPECT_TRUE(check_period(kNoon, {}));
    EXPECT_TRUE(check_period(kNoon, kNoon + 1));
    for (const UtcMicros until : {kNoon, kNoon - kDay}) {
        const auto refused = check_period(kNoon, until);
        ASSERT_FALSE(refused);
        EXPECT_EQ(refused.error().code, ErrorCode::invalid_argument);
        EXPECT_THAT(refused.error().what, testing::HasSubstr(format_utc(until)));
    }
}

TEST(StoreCounts, are_by_period_recipe_verdict_and_reason_and_add_up_to_the_results) {
    const TempFolder folder;
    Story story;
    story.add(recipe("lens", "a")).add_results(1, 25);  // a tenth of a second apart; each tenth is a reject
    write(folder, story);
    auto reader = StoreReader::open(folder.path());
    ASSERT_TRUE(reader);
    std::vector<ResultCount> counts, kinds;
    const auto period = std::chrono::seconds(1);
    ASSERT_TRUE(
        (*reader)->each_count(kNoon, kNoon + 2 * kSecond, period, [&](const ResultCount& c) { counts.push_back(c); }));
    std::map<std::pair<UtcMicros, std::string>, std::int64_t> parts;
    for (const ResultCount& c : counts) {
        EXPECT_EQ(c.recipe, "lens");
        EXPECT_EQ(c.reason, c.verdict == "reject" ? "neighbours-disagree" : "none");
        parts[{c.since_us, c.verdict}] += c.parts;
    }
    // Results 1 to 9 are of the first second, 10 to 19 of the next; those from 20 on are too late.
    EXPECT_EQ(
        parts,
        (decltype(parts){{{kNoon, "pass"}, 9}, {{kNoon + kSecond, "pass"}, 9}, {{kNoon + kSecond, "reject"}, 1}}));
    ASSERT_TRUE((*reader)->each_kind_count(kNoon, kNoon + 10 * kSecond, period,
                                           [&](const ResultCount& c) { kinds.push_back(c); }));
    ASSERT_EQ(kinds.size(), 4U);  // two rejects, each with two kinds
    for (const ResultCount& c : kinds) {
        EXPECT_TRUE(c.kind == "scratch" || c.kind == "absorbing") << c.kind;
        EXPECT_EQ(c.recipe, "lens");
        EXPECT_EQ(c.parts, 1);
    }
}

TEST(StoreCounts, of_kinds_are_of_parts_that_did_not_pass_from_the_first_moment_to_before_the_last) {
    const TempFolder folder;
    Story story;
    const auto add = [&](std::uint32_t sequence, PartVerdict verdict, const std::vector<algo::DefectKind>& kinds) {
        ResultRecord record = result(sequence);  // at a tenth of its sequence, in seconds
        record.result.verdict = verdict;
        for (const algo::DefectKind kind : kinds) record.defects.push_back({1, 1, 1, 1, kind});
        story.add(record);
    };
    using Kind = algo::DefectKind;
    add(19, PartVerdict::reject, {Kind::scratch});
    add(20, PartVerdict::reject, {Kind::scratch, Kind::absorbing, Kind::scratch});
    add(30, PartVerdict::pass, {Kind::scratch});
    add(39, PartVerdict::unfit, {Kind::scratch});
    add(40, PartVerdict::reject, {Kind::absorbing});
    add(60, PartVerdict::reject, {Kind::absorbing});
    write(folder, story);
    std::vector<std::string> found;
    const auto reader = std::move(*StoreReader::open(folder.path()));
    ASSERT_TRUE(reader->each_kind_count(kNoon + 2 * kSecond, kNoon + 6 * kSecond, std::chrono::seconds(2),
                                        [&](const ResultCount& c) {
                                            EXPECT_EQ(c.verdict + c.reason + c.recipe, "");
                                            found.push_back(std::to_string((c.since_us - kNoon) / kSecond) + " " +
                                                            c.kind + " " + std::to_string(c.parts));
                                        }));
    EXPECT_THAT(found, ::testing::UnorderedElementsAre("2 absorbing 1", "2 scratch 2", "4 absorbing 1"));
}

// A result each tenth of a second; 10 and 20 are rejects, 10 in the second second.
TEST(StoreScores, are_mean_and_highest_of_those_that_passed_and_highest_of_the_others) {
    const TempFolder folder;
    Story story;
    story.add_results(1, 25);
    write(folder, story);
    auto reader = StoreReader::open(folder.path());
    ASSERT_TRUE(reader);
    std::vector<ScoreCount> scores;
    ASSERT_TRUE((*reader)->each_score(kNoon, kNoon + 2 * kSecond, std::chrono::seconds(1),
                                      [&](const ScoreCount& c) { scores.push_back(c); }));
    const auto all = results(folder);
    ASSERT_EQ(scores.size(), 2U);
    for (const ScoreCount& second : scores) {
        double sum = 0, highest = 0;
        int passed = 0;
        std::optional<double> other;
        for (const StoredResult& r : all) {
            if (r.time_us < second.since_us || r.time_us >= second.since_us + kSecond || !r.score) continue;
            if (r.verdict != "pass") other = std::max(other.value_or(0), *r.score);
            else {
                sum += *r.score;
                ++passed;
                highest = std::max(highest, *r.score);
            }
        }
        ASSERT_GT(passed, 5);
        EXPECT_NEAR(second.passed_mean.value_or(-1), sum / passed, 1e-12);
        EXPECT_EQ(second.passed_highest, highest);
        EXPECT_EQ(second.other_highest, other);
    }
    EXPECT_FALSE(scores[0].other_highest);
    EXPECT_TRUE(scores[1].other_highest);
}

TEST(Export, heads_of_tables_stand_above_their_columns) {
    StoredResult r;
    r.number = 7;
    r.part = 107;
    r.verdict = "reject";
    r.reason = "neighbours-disagree";
    r.score = 1.25;
    r.bounded = true;
    r.defect_count = 2;
    r.defects = R"([{"kind":"scratch"},{"kind":"absorbing"},{"kind":"scratch"}])";
    r.latency_us = 4260;
    r.reject = "confirmed";
    r.recipe = "lens";
    const std::string head = table_head_of_results(), row = to_table(r);
    for (const auto& [name, value] :
         {std::pair("part", "107"), std::pair("verdict", "reject"), std::pair("reason", "neighbours-disagree"),
          std::pair("score", "<=1.250"), std::pair("latency ms", "4.3"), std::pair("recipe", "lens")}) {
        const auto from = head.find(name), to = row.find(value);
        ASSERT_NE(from, std::string::npos) << head;
        ASSERT_NE(to, std::string::npos) << row;
        EXPECT_TRUE(from == to || from + std::string_view(name).size() == to + std::string_view(value).size())
            << head << "\n"
            << row;
    }
    r.bounded = false;
    EXPECT_EQ(to_table(r).find("<="), std::string::npos);
    r.score.reset();
    EXPECT_EQ(to_table(r).find("1.25"), std::string::npos);
    EXPECT_THAT(table_head_of_changes(), ::testing::StartsWith("time (UTC)"));
}

TEST(Export, tells_what_retention_removed_also_of_older_software) {
    EXPECT_EQ(describe_removal("x"), "x");
    EXPECT_EQ(describe_removal(R"({"from":3})"), R"({"from":3})");
    EXPECT_EQ(describe_removal(R"({"to":3})"), R"({"to":3})");
    EXPECT_EQ(describe_removal(R"({"from":3,"to":9})"), "3 to 9 removed");
    EXPECT_EQ(describe_removal(R"({"from":3,"to":9,"first_time":"a","last_time":"b","rule":"keep_mb",)"
                               R"("used_bytes":5999999,"limit_bytes":4000000})"),
              "3 to 9 (a to b) removed: the store had 5 MB (keep_mb 4)");
    EXPECT_EQ(describe_removal(R"({"from":3,"to":9,"rule":"keep_days"})"),
              "3 to 9 removed: 0 days old and more (keep_days 0), by the days that the clock has shown since ?");
    EXPECT_EQ(describe_removal(R"({"from":3,"to":9,"rule":"keep_days","age_days":8,"limit":7,"witnessed":"c"})"),
              "3 to 9 removed: 8 days old and more (keep_days 7), by the days that the clock has shown since c");
}

}  // namespace
}  // namespace hord::firmware::store::test
