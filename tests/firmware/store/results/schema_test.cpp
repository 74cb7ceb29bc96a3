// A store that older software wrote.
#include "firmware/store/results/schema.h"

#include <array>

#include <fmt/format.h>

#include "tests/firmware/store/results/samples.h"
#include "tests/firmware/store/results/sql.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

// Version 1 has neither the index nor results.bounded, which the hashes of its rows do not cover.
void turn_into_version_1(const TempFolder& folder) {
    sql(folder,
        "DROP INDEX results_not_passed; ALTER TABLE results DROP COLUMN bounded; UPDATE results SET v = 1; "
        "PRAGMA user_version = 1");
    const auto database = Database::open(folder.path() / "results.db", Database::Access::create);
    ASSERT_TRUE(database);
    Hash hash = genesis(read_store_id(**database).value(), "results");
    std::vector<std::array<Value, 2>> hashes;
    const auto columns = kResults.columns.first(kResults.columns_before_3);
    ASSERT_TRUE((*database)->run(fmt::format("SELECT {} FROM results ORDER BY number", fmt::join(columns, ", ")), {},
                                 [&](const Statement& row) -> Result<void> {
                                     std::vector<Value> values;
                                     for (int column = 0; column < row.columns(); ++column)
                                         values.push_back(row.value(column));
                                     hash = follow(hash, values);
                                     hashes.push_back({values.front(), to_value(hash)});
                                     return {};
                                 }));
    for (const auto& one : hashes) ASSERT_TRUE((*database)->run("UPDATE results SET hash = ?2 WHERE number = ?1", one));
    ASSERT_TRUE(
        (*database)->run("UPDATE heads SET hash = ?1 WHERE chain = 'results'", std::array<Value, 1>{to_value(hash)}));
}

// Another beginning would make every chain of before wrong.
TEST(HashChain, begins_with_the_names_of_the_format_the_store_and_the_chain) {
    const std::string text = "hord-store\nid\nresults";
    EXPECT_EQ(genesis("id", "results"), sha256({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}));
    EXPECT_NE(genesis("id", "results"), genesis("id", "changes"));
}

// docs/store.md: a letter for the type, eight bytes of the value or its length, the lowest first, and its bytes.
TEST(HashChain, follows_with_the_type_the_length_and_the_bytes_of_every_value) {
    const std::array<Value, 7> row{std::monostate{}, std::int64_t{-2}, 1.0,   std::string("a\0b", 3),
                                   std::string(),    Blob{0, 255},     Blob{}};
    const std::string eight(8, '\xFF'), zero(7, '\0');
    std::string text(32, '\x11');
    text += "ni\xFE" + eight.substr(0, 7) + "f" + std::string(6, '\0') + "\xF0\x3F" + "t\3" + zero +
        std::string("a\0b", 3) + "t" + std::string(8, '\0') + "b\2" + zero + std::string("\0\xFF", 2) + "b" +
        std::string(8, '\0');
    Hash before{};
    before.fill(0x11);
    const Hash after = follow(before, row);
    EXPECT_EQ(after, sha256({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}));
    EXPECT_EQ(hash_from_hex(to_hex(after)), std::optional(after));
    EXPECT_TRUE(equals(to_value(after), after));
    EXPECT_FALSE(equals(to_value(before), after));
    EXPECT_FALSE(equals(Value(std::string(32, '\x11')), before));
    for (const std::string& wrong : {std::string(), std::string(63, 'a'), std::string(65, 'a'),
                                     "g" + std::string(63, 'a'), std::string(63, 'a') + "-", std::string(64, ' ')})
        EXPECT_FALSE(hash_from_hex(wrong)) << wrong;
}

TEST(Migration, brings_an_older_file_up_to_date_and_says_so_in_the_changes) {
    const TempFolder folder;
    write(folder, Story().add_results(1, 40));
    turn_into_version_1(folder);
    EXPECT_EQ(StoreReader::open(folder.path()).error().code, ErrorCode::unsupported);
    write(folder, Story(start(8)).add_results(1, 2));
    EXPECT_EQ(sql_integer(folder, "PRAGMA user_version"), static_cast<std::uintmax_t>(kSchemaVersion));
    EXPECT_EQ(sql_integer(folder, "SELECT count(*) FROM sqlite_schema WHERE name = 'results_not_passed'"), 1U);
    const std::vector<StoredResult> rows = results(folder);
    ASSERT_THAT(rows, SizeIs(42));
    EXPECT_FALSE(rows[39].bounded.has_value()) << "nobody knows it of an older row";
    EXPECT_EQ(rows[40].bounded, false);
    EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
    ResultFilter filter;
    filter.verdict = "reject";
    EXPECT_THAT(results(folder, filter), SizeIs(4));
    std::vector<std::string> migrations;
    for (const StoredChange& change : changes(folder)) {
        if (change.what == "migration") migrations.push_back(change.before + " to " + change.after);
    }
    EXPECT_THAT(migrations, ::testing::ElementsAre("1 to " + std::to_string(kSchemaVersion)));
}

TEST(Migration, of_a_file_of_version_2_only_adds_what_came_after_it) {
    const TempFolder folder;
    write(folder, Story().add_results(1, 4));
    turn_into_version_1(folder);
    sql(folder,
        "CREATE INDEX results_not_passed ON results (verdict, number) WHERE verdict <> 'pass'; PRAGMA user_version = "
        "2");
    write(folder, Story(start(8)).add_results(1, 2));
    EXPECT_EQ(sql_integer(folder, "PRAGMA user_version"), static_cast<std::uintmax_t>(kSchemaVersion));
    EXPECT_THAT(results(folder), SizeIs(6));
    EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
}

TEST(Migration, of_older_rows_does_not_hide_that_one_was_called_bounded) {
    const TempFolder folder;
    write(folder, Story().add_results(1, 4));
    turn_into_version_1(folder);
    write(folder, Story(start(8)).add_results(1, 2));
    sql(folder, "UPDATE results SET bounded = 0 WHERE number = 3");
    EXPECT_THAT(verify(folder.path()).problems,
                ::testing::ElementsAre(::testing::HasSubstr("row 3 is not as it was written")));
}

// Tables of older files are not STRICT, and stay so.
TEST(Migration, of_tables_that_take_any_value_leaves_the_check_to_the_readers) {
    const TempFolder folder;
    write(folder, Story().add_results(1, 4));
    turn_into_version_1(folder);
    loosen(folder);
    sql(folder, "UPDATE results SET score = 'x' WHERE number = 2; UPDATE results SET time_us = NULL WHERE number = 3");
    write(folder, Story(start(8)).add_results(1, 2));
    sql(folder, "UPDATE results SET bounded = x'00' WHERE number = 5");
    std::vector<std::int64_t> damaged;
    for (const StoredResult& row : results(folder)) {
        if (!row.damage.empty()) damaged.push_back(row.number);
    }
    EXPECT_THAT(damaged, ::testing::ElementsAre(2, 3, 5));
}

TEST(Migration, that_fails_leaves_the_older_file_as_it_was) {
    const TempFolder folder;
    write(folder, Story().add_results(1, 40));
    turn_into_version_1(folder);
    sql(folder, "CREATE TABLE results_not_passed (in_the_way)");
    EXPECT_FALSE(open_sqlite_store(folder.path()));
    EXPECT_EQ(sql_integer(folder, "PRAGMA user_version"), 1U);
    sql(folder, "DROP TABLE results_not_passed");
    write(folder, Story(start(8)).add_results(1, 2));
    EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
}

}  // namespace
}  // namespace hord::firmware::store::test
