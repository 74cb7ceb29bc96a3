// Records as rows, and rows as text: value by value, because rows are hashed and external programs read the text.
#include "firmware/store/results/records.h"

#include <chrono>
#include <cmath>
#include <limits>

#include "firmware/store/results/export.h"
#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::ElementsAre;
using ::testing::EndsWith;

Value integer(std::int64_t value) { return value; }
Value text(std::string_view value) { return std::string(value); }

TEST(Records, hold_the_values_of_a_result_in_the_order_of_its_table) {
    EXPECT_THAT(values_of(result(2, PartVerdict::reject), integer(5), Value{}),
                ElementsAre(integer(2), integer(102), text("reject"), text("neighbours-disagree"),
                            Value(static_cast<double>(0.2F)), integer(2),
                            text(R"([{"m":12.25,"n":3.5,"area":9,"peak":1.7,"kind":"scratch"},)"
                                 R"({"m":40,"n":41,"area":4,"peak":1.1,"kind":"absorbing"}])"),
                            integer(4202), integer(400'000), text("confirmed"), integer(5), Value{}, integer(1)));
    EXPECT_EQ(values_of(result(3), Value{}, integer(7))[11], integer(7));
    EXPECT_EQ(values_of(result(3), Value{}, Value{}).back(), integer(0)) << "not bounded";
}

TEST(Records, hold_no_score_that_SQLite_would_not_give_back) {
    ResultRecord record = result(1);
    for (const float none : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
                             -std::numeric_limits<float>::infinity()}) {
        record.result.score = none;
        EXPECT_EQ(values_of(record, {}, {})[4], Value{}) << none;
    }
    record.result.score = -0.0F;
    EXPECT_FALSE(std::signbit(std::get<double>(values_of(record, {}, {})[4])));
}

TEST(Records, hold_a_change_with_what_it_is_and_a_command_without) {
    using What = ChangeRecord::What;
    const auto row = [](What what) { return values_of(ChangeRecord{what, kNoon, "plc:1", 9, "name", "old", "new"}); };
    const std::pair<What, const char*> names[] = {{What::recipe, "recipe"},
                                                  {What::configuration, "configuration"},
                                                  {What::calibration, "calibration"},
                                                  {What::lost, "lost"}};
    for (const auto& [what, name] : names) {
        EXPECT_THAT(row(what),
                    ElementsAre(text(name), text("plc:1"), integer(9), text("name"), text("old"), text("new")));
    }
    EXPECT_THAT(row(What::command), ElementsAre(text("plc:1"), integer(9), text("name"), text("old"), text("new")));
    EXPECT_THAT(values_of(start(7), "before"),
                ElementsAre(text("start"), text(""), integer(0), text("cell 3"), text("before"),
                            text(R"({"boot":7,"software":"0.1.0"})")));
}

TEST(StoredJson, gives_members_of_their_type_and_none_for_everything_else) {
    const Json json =
        Json::parse(R"({"a":-5,"b":9223372036854775807,"c":9223372036854775808,"d":1.5,"e":"x","f":null})");
    EXPECT_EQ(integer_in(json, "a"), -5);
    EXPECT_EQ(integer_in(json, "b"), std::numeric_limits<std::int64_t>::max());
    for (const char* none : {"c", "d", "e", "f", "g"}) EXPECT_FALSE(integer_in(json, none)) << none;
    EXPECT_EQ(text_in(json, "e"), "x");
    for (const char* none : {"a", "f", "g"}) EXPECT_FALSE(text_in(json, none)) << none;
    for (const char* other : {"[1]", "\"a\"", "7", "null"}) {
        EXPECT_FALSE(integer_in(Json::parse(other), "a")) << other;
        EXPECT_FALSE(text_in(Json::parse(other), "a")) << other;
    }
}

TEST(StoredJson, is_written_in_one_line_in_the_order_of_insertion) {
    const Json json{
        {"z", 1}, {"a", {0.1F, 40.0F, -2, true, nullptr, "q\"\n"}}, {"o", {{"k", 1.5}, {"l", Json::array()}}}};
    EXPECT_EQ(to_line(json), R"({"z":1,"a":[0.1,40,-2,true,null,"q\"\n"],"o":{"k":1.5,"l":[]}})");
    EXPECT_EQ(to_line(Json::object()), "{}");
    EXPECT_EQ(to_text({{"a", {1, 2}}}), R"({"a":[1,2]})");
    EXPECT_EQ(to_text({{"a", 1}}, 2), "{\n  \"a\": 1\n}");
    EXPECT_EQ(to_text(Json("a\xFF")), "\"a\xEF\xBF\xBD\"") << "no UTF-8";
}

TEST(Export, tells_who_made_a_change) {
    StoredChange change;
    change.time_us = kNoon;
    change.what = "recipe";
    change.name = "lens";
    change.before = "a";
    const auto who = [&] { return to_table(change).substr(39, 37); };
    EXPECT_EQ(to_table(change).substr(0, 39), "2026-09-21T14:13:20.000Z recipe        ");
    EXPECT_EQ(who(), "station                              ");
    change.token = 7;
    EXPECT_EQ(who(), "station                              ") << "a token is a client's";
    change.peer = "192.0.2.7:5";
    EXPECT_EQ(who(), "192.0.2.7:5 #7                       ");
    change.token = 0;
    EXPECT_EQ(who(), "192.0.2.7:5                          ");
    EXPECT_THAT(to_table(change), EndsWith(" lens                     a -> (none)"));
    change.what = "retention";
    change.after = R"({"from":3,"to":9})";
    EXPECT_THAT(to_table(change), EndsWith(" 3 to 9 removed"));
}

TEST(Export, keeps_the_columns_of_changes_whatever_stands_in_them) {
    StoredChange change;
    change.time_us = kNoon;
    change.what = "configuration";
    change.peer = "[2001:db8:85a3:8d3:1319:8a2e:370:7348]:50123 for anna";
    change.name = "/srv/stations/Zelle Süd/hordd.toml";
    const auto column = table_head_of_changes().find("before -> after");
    EXPECT_EQ(to_table(change),
              "2026-09-21T14:13:20.000Z configuration ...319:8a2e:370:7348]:50123 for anna .../Zelle Süd/hordd.toml "
              "no file: every key has its default");
    EXPECT_EQ(to_table(change).find("no file"), column + 1) << "ü has two bytes";
}

TEST(Export, quotes_a_field_of_CSV_only_where_it_must) {
    const auto field = [](const std::string& name) {
        StoredChange change;
        change.peer = "plc";
        change.name = name;
        const std::string line = to_csv(change), before = "0,1970-01-01T00:00:00.000Z,0,,plc,0,";
        EXPECT_EQ(line.substr(0, before.size()), before);
        return line.substr(before.size(), line.size() - before.size() - 2);
    };
    EXPECT_EQ(field("a b;c"), "a b;c");
    EXPECT_EQ(field("a,b"), "\"a,b\"");
    EXPECT_EQ(field("a\"b"), "\"a\"\"b\"");
    EXPECT_EQ(field("a\nb"), "\"a\nb\"");
    EXPECT_EQ(field("a\rb"), "\"a\rb\"");
}

TEST(Export, of_a_row_that_was_edited_says_what_is_there) {
    StoredResult row;
    EXPECT_EQ(to_json(row)["defects"], "") << "no JSON";
    EXPECT_FALSE(to_json(row).contains("damage"));
    EXPECT_TRUE(to_json(row)["score"].is_null());
    EXPECT_TRUE(to_json(row)["bounded"].is_null());
    row.damage = "score is TEXT, not REAL";
    row.bounded = true;
    EXPECT_EQ(to_json(row)["damage"], row.damage);
    EXPECT_EQ(to_json(row)["bounded"], true);
    const auto csv_of = [&](const char* defects) {
        row.defects = defects;
        return to_csv(row);
    };
    const std::string none = csv_of("[]");
    for (const char* other : {"[7]", "[]", "{}", "x", R"([{"kind":5}])", R"([{"n":[]}])"})
        EXPECT_EQ(csv_of(other).find("null"), std::string::npos) << other;
    EXPECT_EQ(csv_of("[7]"), none);
    EXPECT_NE(csv_of(R"([{"m":1.5,"n":2,"kind":"scratch"},{"m":9,"n":9,"kind":"absorbing"}])")
                  .find(",absorbing scratch,1.5,2,"),
              std::string::npos)
        << row.defects;
    StoredChange change;
    EXPECT_FALSE(to_json(change).contains("damage"));
    change.damage = "x";
    EXPECT_EQ(to_json(change)["damage"], "x");
}

TEST(Export, writes_times_from_year_0_to_9999_and_the_number_of_others) {
    EXPECT_EQ(format_utc(-62'167'219'200 * kSecond), "0000-01-01T00:00:00.000Z");
    EXPECT_EQ(format_utc(-62'167'219'200 * kSecond - 1), "-62167219200000001 us");
    EXPECT_EQ(format_utc(253'402'300'800 * kSecond - 1), "9999-12-31T23:59:59.999Z");
    EXPECT_EQ(format_utc(253'402'300'800 * kSecond), "253402300800000000 us");
    const UtcMicros clock =
        std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
            .count();
    EXPECT_NEAR(static_cast<double>(utc_now() - clock), 0, 60e6);
}

TEST(Export, reads_a_time_to_the_second_and_nothing_behind_it) {
    EXPECT_EQ(*parse_utc("1970-01-02T03:04:05", 0), (86'400 + 3 * 3600 + 4 * 60 + 5) * kSecond);
    EXPECT_EQ(*parse_utc("1970-01-02T03:04:05Z", 0), *parse_utc("1970-01-02T03:04:05", 0));
    EXPECT_EQ(*parse_utc("1970-12-31Z", 0), 364 * kDay);
    EXPECT_EQ(*parse_utc("2026-02-28", 0) + kDay, *parse_utc("2026-03-01", 0));
    for (const char* bad : {"5", "Z", "d", "1970-01-02T03:04:05 ", "1970-01-02T03:04:05ZZ", "1970-13-01", "1970-00-01",
                            "1970-01-00", "1970-01-32", "1970-01-02T24:00", "1970-01-02T03:60", "1970-01-02T03:04:60",
                            "1970-01-02T03:04:", "1970-01-02 03:04", "99999999999999999999s", "1970-01"}) {
        const auto read = parse_utc(bad, 0);
        ASSERT_FALSE(read) << bad;
        EXPECT_EQ(read.error().code, ErrorCode::invalid_argument);
        EXPECT_EQ(read.error().what, "\"" + std::string(bad) + "\" is no time");
    }
}

}  // namespace
}  // namespace hord::firmware::store::test
