// A store with any damaged value, any flipped bit, or on a disk that does not answer: always a named error or a clean
// run, never an exception. An abort of this program is a failure, too.
#include <random>
#include <set>

#include <pwd.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/store/results/database.h"
#include "firmware/store/results/export.h"
#include "firmware/store/results/store_queue.h"
#include "tests/firmware/store/results/samples.h"
#include "tests/firmware/store/results/sql.h"

namespace hord::firmware::store::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr Retention kRetention{.keep_days = 3, .max_bytes = 200'000};

Story first_run() {
    Story run;
    run.add(recipe("a", "1")).add_results(1, 60);
    for (std::uint32_t k = 1; k <= 5; ++k)
        run.add(ChangeRecord{ChangeRecord::What::command, kNoon + k, "plc:1", k, "stop", "Ready", "completed"});
    return run.add(AcknowledgeRecord{kNoon, "plc:1", 60});
}

// A store with every kind of row: runs, recipes, commands, days, removed rows, an acknowledgement.
void fill(const TempFolder& folder) {
    Calendar calendar;
    {
        const auto store = open(folder);
        ASSERT_TRUE(store->write(first_run().entries()));
        ASSERT_TRUE(calendar.live(*store, {.keep_days = 1, .max_bytes = 0}, 11));
    }
    write(folder, Story(start(8)).add(recipe("b", "2")).add_results(1, 60));
}

struct Said {
    std::vector<std::string> errors;
    void hear(const Error& error) {
        EXPECT_NE(error.code, ErrorCode::internal) << error.message();
        EXPECT_FALSE(error.cure.empty()) << error.message();
        errors.push_back(error.message());
    }
};

// What people at a station do with a store: list, filter, verify.
void read(const fs::path& folder, Said& said) {
    auto reader = StoreReader::open(folder);
    if (!reader) return said.hear(reader.error());
    const auto hear = [&](const Result<void>& done) {
        if (!done) said.hear(done.error());
    };
    std::size_t bytes = 0;
    const auto write_row = [&](const auto& row) {
        bytes += to_csv(row).size() + to_line(to_json(row)).size() + to_table(row).size();
        if (!row.damage.empty()) said.errors.push_back(row.damage);
    };
    hear((*reader)->each_result({}, write_row));
    hear((*reader)->each_change({}, write_row));
    ResultFilter filter;
    filter.boot = 8;
    filter.kind = "scratch";
    filter.reason = "neighbours-disagree";
    hear((*reader)->each_result(filter, write_row));
    const auto verified = (*reader)->verify();
    if (!verified) said.hear(verified.error());
    else said.errors.insert(said.errors.end(), verified->problems.begin(), verified->problems.end());
}

// What a station does with a store: start, write, prune, open again; people read it before and after.
void use(const fs::path& folder, Said& said) {
    read(folder, said);
    {
        StoreQueue queue([&] { return open_sqlite_store(folder); }, {.retention = kRetention, .thread = false},
                         start(9), [] { return kNoon + 20 * kDay; },
                         {[&](const Error& error) { said.hear(error); }, [] {}});
        queue.add(recipe("c", "3"));
        for (std::uint32_t k = 1; k <= 30; ++k) queue.add(result(k));
        (void)queue.step();
        (void)queue.step();
    }
    if (auto store = open_sqlite_store(folder)) {
        if (auto done = (*store)->write(Story(start(8)).add_results(1, 61).entries()); !done) said.hear(done.error());
        Calendar later;
        later.pass(30 * kDay);
        if (auto done = later.live(**store, kRetention, 15); !done && done.error().code != ErrorCode::internal)
            said.hear(done.error());
    } else {
        said.hear(store.error());
    }
    read(folder, said);
}

void copy(const TempFolder& from, const TempFolder& to) {
    for (const auto& entry : fs::directory_iterator(from.path()))
        fs::copy(entry.path(), to.path() / entry.path().filename(), fs::copy_options::overwrite_existing);
}

void make_strict_again(const TempFolder& folder, const TempFolder& whole) {
    sql(folder,
        "ATTACH '" + (whole.path() / kStoreFile).string() +
            "' AS whole; PRAGMA writable_schema = ON; UPDATE main.sqlite_schema AS mine SET sql = (SELECT sql FROM "
            "whole.sqlite_schema AS theirs WHERE theirs.name = mine.name) WHERE type = 'table'");
}

std::vector<std::string> columns_of(const TempFolder& folder, const std::string& table) {
    std::vector<std::string> names;
    auto database = Database::open(folder.path() / kStoreFile, Database::Access::read);
    EXPECT_TRUE(database);
    EXPECT_TRUE((*database)->run("SELECT name FROM pragma_table_info('" + table + "')", {},
                                 [&](const Statement& row) -> Result<void> {
                                     names.push_back(row.text(0).value());
                                     return {};
                                 }));
    return names;
}

// HORD_EDITS=N makes one edit in N.
class EveryValue : public ::testing::TestWithParam<bool> {};

TEST_P(EveryValue, of_every_column_may_be_damaged) {
    const bool strict = GetParam();
    const TempFolder whole, loose;
    fill(whole);
    {
        const TempFolder used;
        copy(whole, used);
        Said said;
        use(used.path(), said);
        ASSERT_THAT(said.errors, IsEmpty());
    }
    copy(whole, loose);
    loosen(loose);
    constexpr const char* kValues[] = {"NULL",
                                       "'x'",
                                       "''",
                                       "x'00ff'",
                                       "9223372036854775807",
                                       "-9223372036854775808",
                                       "1.5e300",
                                       R"('{"boot":"x","software":7,"to":"x","hash":5,"day":"x","kind":9}')",
                                       R"('[{"kind":5,"m":"x"},7]')"};
    const char* wanted = std::getenv("HORD_EDITS");
    const std::size_t every = wanted != nullptr ? std::max<std::size_t>(1, std::strtoul(wanted, nullptr, 10)) : 1;
    std::size_t considered = 0, edits = 0, found = 0;
    for (const std::string table : {"meta", "results", "commands", "changes", "heads", "acknowledged"}) {
        for (const std::string& column : columns_of(whole, table)) {
            for (const char* value : kValues) {
                // Every row; and only the newest one, with which the station goes on.
                for (const char* rows : {"", " WHERE rowid = (SELECT max(rowid) FROM "}) {
                    const bool rowid = table != "meta" && table != "heads";
                    if ((!rowid && *rows != '\0') || considered++ % every != 0) continue;
                    const TempFolder folder;
                    copy(loose, folder);
                    sqlite3* db = nullptr;
                    ASSERT_EQ(sqlite3_open((folder.path() / kStoreFile).c_str(), &db), SQLITE_OK);
                    const std::string edit = "UPDATE OR IGNORE " + table + " SET " + column + " = " + value + rows +
                        (*rows == '\0' ? "" : table + ")");
                    const bool done = sqlite3_exec(db, edit.c_str(), nullptr, nullptr, nullptr) == SQLITE_OK &&
                        sqlite3_changes(db) > 0;
                    sqlite3_close(db);
                    if (!done) continue;  // a key that SQLite itself keeps an integer or unique
                    if (strict) make_strict_again(folder, whole);
                    ASSERT_EQ(sql_integer(folder, "SELECT count(*) FROM sqlite_schema WHERE sql LIKE '% STRICT%'"),
                              strict ? 6U : 0U);
                    ++edits;
                    SCOPED_TRACE(edit);
                    Said said;
                    use(folder.path(), said);
                    found += said.errors.empty() ? 0U : 1U;
                    // The table of acknowledgements is no chain. NULL and an empty text may be what was there.
                    if (table != "acknowledged" && std::string(value) != "NULL" && std::string(value) != "''") {
                        EXPECT_THAT(said.errors, Not(IsEmpty()));
                    }
                }
            }
        }
    }
    EXPECT_GT(edits * every, 600U);
    EXPECT_GT(found * every, 500U);
}

INSTANTIATE_TEST_SUITE_P(Damage, EveryValue, ::testing::Values(true, false), [](const auto& test) {
    return std::string(test.param ? "of_a_strict" : "of_an_older_store");
});

// HORD_FLIPS sets how many.
TEST(Damage, of_any_single_bit_ends_nothing) {
    const TempFolder whole;
    fill(whole);
    const std::string bytes = read_text(whole.path() / kStoreFile);
    ASSERT_GT(bytes.size(), 10'000U);
    const char* wanted = std::getenv("HORD_FLIPS");
    const int flips = wanted != nullptr ? std::atoi(wanted) : 400;
    std::mt19937_64 random(20261123);
    int found = 0;
    for (int k = 0; k < flips; ++k) {
        // Every second one in the first two pages: header and schema.
        const std::size_t bit =
            random() % (8 * (k % 2 == 0 ? bytes.size() : std::min<std::size_t>(bytes.size(), 8192)));
        SCOPED_TRACE("bit " + std::to_string(bit));
        std::string damaged = bytes;
        damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
        const TempFolder folder;
        write_text(folder.path() / kStoreFile, damaged);
        Said said;
        use(folder.path(), said);
        found += said.errors.empty() ? 0 : 1;
    }
    EXPECT_GT(found, flips / 10);  // most bytes of these small pages are unused
}

TEST(Damage, of_the_entry_numbers_makes_the_store_skip_nothing) {
    const TempFolder folder;
    const Story run = first_run();
    write(folder, run);
    sql(folder, "UPDATE results SET entry = 1000000 WHERE number = 60");
    const auto store = open(folder);
    Story longer = first_run();
    longer.add_results(61, 70);
    const auto done = store->write(longer.entries());
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().code, ErrorCode::unreadable);
    EXPECT_THAT(done.error().message(), HasSubstr("entry 1000000"));
}

TEST(Damage, is_named_by_column_and_type_in_a_list) {
    const TempFolder folder;
    fill(folder);
    loosen(folder);
    sql(folder, "UPDATE results SET time_us = 'x', sequence = -1 WHERE number = 70");
    std::size_t damaged = 0;
    for (const StoredResult& row : results(folder)) {
        if (row.damage.empty()) continue;
        ++damaged;
        EXPECT_EQ(row.number, 70);
        EXPECT_THAT(row.damage, HasSubstr("time_us is TEXT, not INTEGER"));
        EXPECT_EQ(row.part, 110U);  // what can be read is
    }
    EXPECT_EQ(damaged, 1U);
}

TEST(Damage, of_a_start_row_hides_its_boot_and_no_result) {
    const TempFolder folder;
    fill(folder);
    loosen(folder);
    for (const char* after : {R"('{"boot":"x"}')", R"('{"boot":-1,"software":[]}')", "'x'", "7", "NULL", "x'01'"}) {
        sql(folder, std::string("UPDATE changes SET after = ") + after + " WHERE what = 'start'");
        const auto all = results(folder);
        ASSERT_FALSE(all.empty());
        EXPECT_EQ(all.back().boot, 0U);
        EXPECT_EQ(all.back().sequence, 60U);
    }
}

TEST(Damage, is_not_said_of_a_whole_file_with_another_schema) {
    const TempFolder folder;
    fill(folder);
    sql(folder, "ALTER TABLE results RENAME COLUMN verdict TO judgement");
    auto reader = StoreReader::open(folder.path());
    ASSERT_TRUE(reader) << reader.error().message();
    const auto done = (*reader)->each_result({}, [](const StoredResult&) {});
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().code, ErrorCode::unsupported);
    EXPECT_THAT(done.error().what, testing::AllOf(HasSubstr("verdict"), testing::Not(HasSubstr("damaged"))));
}

TEST(Damage, by_json_that_is_nested_without_end_is_no_json) {
    EXPECT_TRUE(parse_stored(std::string(200'000, '[') + std::string(200'000, ']')).is_discarded());
    EXPECT_TRUE(parse_stored(std::string(200'000, '[')).is_discarded());
    EXPECT_FALSE(parse_stored(R"([{"m":1,"n":[1,2]}])").is_discarded());
}

TEST(StrictStore, refuses_a_value_of_another_type_in_an_edit) {
    const TempFolder folder;
    fill(folder);
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open((folder.path() / kStoreFile).c_str(), &db), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(db, "UPDATE results SET time_us = 'x' WHERE number = 70", nullptr, nullptr, nullptr),
              SQLITE_CONSTRAINT);
    sqlite3_close(db);
}

// -- a disk that does not answer

TEST(BadFolder, is_a_named_error_and_no_exception) {
    const TempFolder folder;
    fs::create_symlink("loop", folder.path() / "loop");
    write_text(folder.path() / "file", "");
    const fs::path bad[] = {folder.path() / "loop/store", folder.path() / "file", folder.path() / "file/store",
                            folder.path() / std::string(300, 'n'), folder.path() / "none/store"};
    for (const fs::path& path : bad) {
        const auto store = open_sqlite_store(path);
        ASSERT_FALSE(store) << path;
        EXPECT_EQ(store.error().code, ErrorCode::io);
        EXPECT_THAT(store.error().message(), HasSubstr("cannot be made or used"));
        const bool behind_file = path.string().find("/file") != std::string::npos;
        EXPECT_EQ(store.error().cure.find("is a file") != std::string::npos, behind_file) << store.error().cure;
        EXPECT_FALSE(StoreReader::open(path));
    }
}

TEST(BadFolder, is_told_with_what_is_in_the_way) {
    const TempFolder folder;
    const fs::path store = folder.path() / "none/store";
    const Error missing = folder_unusable(store, std::make_error_code(std::errc::no_such_file_or_directory)).value();
    EXPECT_THAT(missing.what,
                HasSubstr(store.string() + " cannot be made or used (" + (folder.path() / "none").string() +
                          " does not exist)"));
    const Error mounted = folder_unusable(store, std::make_error_code(std::errc::read_only_file_system)).value();
    EXPECT_EQ(mounted.cure, "mount its disk for writing, or name another folder (store.folder)");
}

TEST(BadFolder, that_answers_with_an_error_is_a_failure_of_the_store_and_is_tried_again) {
    const TempFolder folder;
    SqliteStoreOptions options;
    options.make_folder = [](const fs::path&) { return std::make_error_code(std::errc::io_error); };
    std::vector<std::string> said;
    StoreQueue queue([&] { return open_sqlite_store(folder.path(), options); }, {.thread = false}, start(),
                     [] { return kNoon; }, {[&](const Error& error) { said.push_back(error.message()); }, [] {}});
    queue.add(result(1));
    EXPECT_FALSE(queue.step());
    ASSERT_EQ(said.size(), 1U);
    EXPECT_THAT(said[0], HasSubstr("Input/output error"));
    options = {};
    EXPECT_TRUE(queue.step());
    EXPECT_EQ(results(folder).size(), 1U);
}

// As another user, because root may read every folder.
TEST(BadFolder, under_a_parent_that_may_not_be_read_is_a_named_error) {
    const TempFolder folder;
    fs::create_directories(folder.path() / "parent/store");
    fs::permissions(folder.path(), fs::perms::all);
    fs::permissions(folder.path() / "parent", fs::perms::none);
    const pid_t child = fork();
    if (child == 0) {
        const passwd* nobody = getpwnam("nobody");
        if (geteuid() == 0 && (nobody == nullptr || setuid(nobody->pw_uid) != 0)) _exit(2);
        const auto store = open_sqlite_store(folder.path() / "parent/store");
        const auto reader = StoreReader::open(folder.path() / "parent/store");
        _exit(!store && store.error().code == ErrorCode::io && !reader ? 0 : 1);
    }
    int status = 0;
    waitpid(child, &status, 0);
    fs::permissions(folder.path() / "parent", fs::perms::owner_all);
    ASSERT_TRUE(WIFEXITED(status));
    if (WEXITSTATUS(status) == 2) GTEST_SKIP() << "there is no user nobody, or it cannot be become";
    EXPECT_EQ(WEXITSTATUS(status), 0);
}

}  // namespace
}  // namespace hord::firmware::store::test
