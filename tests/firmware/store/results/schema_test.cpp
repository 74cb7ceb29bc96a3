// A store that older software wrote.
#include "firmware/store/results/schema.h"

#include "tests/firmware/store/results/samples.h"
#include "tests/firmware/store/results/sql.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

// Version 1 differs only in an index.
void turn_into_version_1(const TempFolder& folder) {
    sql(folder, "DROP INDEX results_not_passed; PRAGMA user_version = 1");
}

TEST(Migration, brings_an_older_file_up_to_date_and_says_so_in_the_changes) {
    const TempFolder folder;
    write(folder, Story().add_results(1, 40));
    turn_into_version_1(folder);
    EXPECT_EQ(StoreReader::open(folder.path()).error().code, ErrorCode::unsupported);
    write(folder, Story(start(8)).add_results(1, 2));
    EXPECT_EQ(sql_integer(folder, "PRAGMA user_version"), static_cast<std::uintmax_t>(kSchemaVersion));
    EXPECT_EQ(sql_integer(folder, "SELECT count(*) FROM sqlite_schema WHERE name = 'results_not_passed'"), 1U);
    EXPECT_THAT(results(folder), SizeIs(42));
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
