// SQLite behind its thin layer: values of every type, and what each of its errors is called.
#include "firmware/store/results/database.h"

#include <array>
#include <limits>
#include <optional>

#include <fmt/format.h>

#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::HasSubstr;

class AnyDatabase : public ::testing::Test {
  protected:
    TempFolder folder;
    std::filesystem::path file = folder.path() / "any.db";
    std::unique_ptr<Database> database = std::move(*Database::open(file, Database::Access::create));

    void sql(const std::string& text) {
        const auto done = database->execute(text);
        ASSERT_TRUE(done) << done.error().message();
    }
    Error error_of(const std::string& text) {
        const auto done = database->execute(text);
        EXPECT_FALSE(done) << text;
        return done ? Error{} : done.error();
    }
};

TEST_F(AnyDatabase, gives_back_values_of_every_type) {
    const std::array<Value, 7> values{
        std::monostate{}, std::numeric_limits<std::int64_t>::min(), 0.1, std::string(), std::string("a\0b", 3), Blob{},
        Blob{0, 255}};
    sql("CREATE TABLE t (v)");
    for (const Value& value : values)
        ASSERT_TRUE(database->run("INSERT INTO t VALUES (?1)", std::array<Value, 1>{value}));
    std::vector<Value> back;
    ASSERT_TRUE(database->run("SELECT v FROM t ORDER BY rowid", {}, [&](const Statement& row) -> Result<void> {
        EXPECT_EQ(row.columns(), 1);
        back.push_back(row.value(0));
        return {};
    }));
    EXPECT_TRUE(std::ranges::equal(back, values));
}

TEST_F(AnyDatabase, a_typed_read_of_another_type_names_the_column_and_both_types) {
    const auto read = [&](const char* what, auto take) {
        return database->run(std::string("SELECT ") + what + " AS it", {}, take).error().what;
    };
    const auto integer = [](const Statement& row) { return row.integer(0).map([](std::int64_t) {}); };
    const auto text = [](const Statement& row) { return row.text(0).map([](const std::string&) {}); };
    EXPECT_THAT(read("'x'", integer), HasSubstr("it is TEXT, not INTEGER"));
    EXPECT_THAT(read("1.5", integer), HasSubstr("it is REAL, not INTEGER"));
    EXPECT_THAT(read("NULL", integer), HasSubstr("it is NULL, not INTEGER"));
    EXPECT_THAT(read("x'00'", text), HasSubstr("it is BLOB, not TEXT"));
    EXPECT_THAT(read("7", text), HasSubstr("it is INTEGER, not TEXT"));
    EXPECT_EQ(database->get_integer("SELECT 'x'").error().code, ErrorCode::unreadable);
    EXPECT_EQ(database->get_text("SELECT 1").error().code, ErrorCode::unreadable);
}

TEST_F(AnyDatabase, no_row_and_null_are_nothing) {
    for (const char* none : {"SELECT 1 WHERE 0", "SELECT NULL"}) {
        EXPECT_EQ(database->get_integer(none).value(), 0);
        EXPECT_EQ(database->get_text(none).value(), "");
        EXPECT_EQ(database->get(none).value(), Value{});
    }
    EXPECT_EQ(database->get_integer("SELECT -5").value(), -5);
    EXPECT_EQ(database->get_text("SELECT 'a'").value(), "a");
}

TEST_F(AnyDatabase, a_row_is_read_to_its_end_and_its_first_error_is_kept) {
    const auto read = [&](const char* columns, auto take) {
        ASSERT_TRUE(database->run(std::string("SELECT ") + columns, {}, [&](const Statement& row) -> Result<void> {
            RowReader reader(row);
            take(reader);
            return {};
        }));
    };
    read("4294967295 AS a, 0 AS b, 1.5 AS c, NULL AS d, NULL AS e, 'x' AS f, 7 AS g", [](RowReader& r) {
        EXPECT_EQ(r.natural(0), 0xFFFFFFFFU);
        EXPECT_EQ(r.natural(1), 0U);
        EXPECT_EQ(r.real_or_null(2), 1.5);
        EXPECT_EQ(r.real_or_null(3), std::nullopt);
        EXPECT_EQ(r.integer_or_null(4), std::nullopt);
        EXPECT_EQ(r.text_or_empty(5), "x");
        EXPECT_EQ(r.text_or_empty(6), "") << "of another type, and no error";
        EXPECT_EQ(r.integer_or_null(6), 7);
        EXPECT_FALSE(r.error());
    });
    read("-1 AS a, 4294967296 AS b, 'x' AS c, 1 AS d", [](RowReader& r) {
        EXPECT_EQ(r.natural(0), 0U);
        ASSERT_TRUE(r.error());
        EXPECT_THAT(r.error()->what, HasSubstr("a is out of range"));
        EXPECT_EQ(r.natural(1), 0U);
        EXPECT_EQ(r.integer(2), 0);
        EXPECT_EQ(r.text(3), "");
        EXPECT_EQ(r.real_or_null(3), std::nullopt);
        EXPECT_THAT(r.error()->what, HasSubstr("a is out of range"));
    });
    for (const char* wrong : {"'x' AS a", "4294967296 AS a", "1.5 AS a", "NULL AS a"}) {
        read(wrong, [&](RowReader& r) {
            (void)r.natural(0);
            EXPECT_TRUE(r.error()) << wrong;
        });
    }
    read("1 AS a", [](RowReader& r) {
        (void)r.real_or_null(0);
        EXPECT_TRUE(r.error()) << "an integer was not written as REAL";
    });
    read("1 AS a", [](RowReader& r) {
        EXPECT_EQ(r.text(0), "");
        EXPECT_TRUE(r.error()) << "an integer was not written as TEXT";
    });
}

TEST_F(AnyDatabase, an_error_of_the_reader_ends_the_run) {
    int rows = 0;
    const auto done = database->run("SELECT 1 UNION ALL SELECT 2", {}, [&](const Statement&) -> Result<void> {
        ++rows;
        return fail(ErrorCode::refused, "enough", "");
    });
    EXPECT_EQ(done.error().what, "enough");
    EXPECT_EQ(rows, 1);
}

TEST_F(AnyDatabase, the_same_text_runs_again_with_other_values_inside_itself_and_after_a_change_of_the_table) {
    const char* const text = "SELECT * FROM t WHERE a >= ?1 ORDER BY a";
    sql("CREATE TABLE t (a); INSERT INTO t VALUES (1), (2)");
    const auto from = [&](std::int64_t first, const Statement::Take& take) {
        const auto done = database->run(text, std::array<Value, 1>{first}, take);
        EXPECT_TRUE(done) << done.error().message();
    };
    std::vector<std::int64_t> seen;
    from(1, [&](const Statement& outer) -> Result<void> {
        seen.push_back(*outer.integer(0));
        from(2, [&](const Statement& inner) -> Result<void> {
            seen.push_back(10 * *inner.integer(0));
            return {};
        });
        return {};
    });
    EXPECT_THAT(seen, ::testing::ElementsAre(1, 20, 2, 20));
    sql("ALTER TABLE t ADD COLUMN b DEFAULT 7");
    from(2, [](const Statement& row) -> Result<void> {
        EXPECT_EQ(row.columns(), 2);
        EXPECT_EQ(row.value(1), Value(std::int64_t{7}));
        return {};
    });
    // More texts than are kept.
    for (int k = 0; k < 50; ++k) EXPECT_EQ(database->get_integer(fmt::format("SELECT {}", k)), k);
}

TEST_F(AnyDatabase, a_transaction_that_is_not_committed_changes_nothing) {
    sql("CREATE TABLE t (v)");
    {
        auto transaction = Transaction::begin(*database);
        ASSERT_TRUE(transaction);
        sql("INSERT INTO t VALUES (1)");
    }
    EXPECT_EQ(database->get_integer("SELECT count(*) FROM t").value(), 0);
    {
        auto transaction = Transaction::begin(*database);
        ASSERT_TRUE(transaction);
        sql("INSERT INTO t VALUES (1)");
        EXPECT_TRUE(transaction->commit());
    }
    EXPECT_EQ(database->get_integer("SELECT count(*) FROM t").value(), 1);
    EXPECT_TRUE(Transaction::begin(*database)) << "and it is over";
}

TEST_F(AnyDatabase, a_transaction_that_was_committed_ends_no_other) {
    sql("CREATE TABLE t (v)");
    std::optional<Transaction> first(std::move(*Transaction::begin(*database)));
    ASSERT_TRUE(first->commit());
    auto second = Transaction::begin(*database);
    ASSERT_TRUE(second);
    sql("INSERT INTO t VALUES (1)");
    first.reset();
    EXPECT_TRUE(second->commit());
    EXPECT_EQ(database->get_integer("SELECT count(*) FROM t").value(), 1);
}

// -- errors

TEST_F(AnyDatabase, a_full_disk_is_no_damage) {
    sql("CREATE TABLE t (v); PRAGMA max_page_count = 3");
    const Error full = error_of("INSERT INTO t VALUES (zeroblob(100000))");
    EXPECT_EQ(full.code, ErrorCode::io);
    EXPECT_THAT(full.message(), HasSubstr("the disk is full"));
    EXPECT_THAT(full.cure, HasSubstr("store.keep_mb"));
    EXPECT_TRUE(database->disk_full());
}

TEST_F(AnyDatabase, a_file_that_may_only_be_read_is_no_damage) {
    sql("CREATE TABLE t (v)");
    database = std::move(*Database::open(file, Database::Access::read));
    const Error refused = error_of("INSERT INTO t VALUES (1)");
    EXPECT_EQ(refused.code, ErrorCode::io);
    EXPECT_THAT(refused.message(), HasSubstr("cannot be written"));
}

TEST_F(AnyDatabase, values_that_the_store_cannot_have_written_are_damage) {
    sql("CREATE TABLE t (n INTEGER PRIMARY KEY, v INTEGER NOT NULL) STRICT; INSERT INTO t VALUES (1, 1)");
    for (const char* wrong :
         {"INSERT INTO t VALUES (1, 2)", "INSERT INTO t VALUES (2, NULL)", "INSERT INTO t VALUES (2, 'x')",
          "INSERT INTO t VALUES ('x', 1)", "SELECT zeroblob(64000001)"}) {
        const Error damage = error_of(wrong);
        EXPECT_EQ(damage.code, ErrorCode::unreadable) << wrong;
        EXPECT_THAT(damage.what, HasSubstr("is damaged")) << wrong;
    }
    sql("SELECT zeroblob(64000000)");
}

TEST_F(AnyDatabase, that_another_program_holds_is_locked_and_no_damage) {
    sql("CREATE TABLE t (v); PRAGMA busy_timeout = 1");
    const auto other = std::move(*Database::open(file, Database::Access::create));
    ASSERT_TRUE(other->execute("BEGIN EXCLUSIVE"));
    const Error held = error_of("INSERT INTO t VALUES (1)");
    EXPECT_EQ(held.code, ErrorCode::busy);
    EXPECT_THAT(held.what, HasSubstr("is locked by another program"));
}

TEST_F(AnyDatabase, a_value_without_a_place_and_a_place_without_a_value_are_refused) {
    const std::array<Value, 2> two{std::int64_t{1}, std::int64_t{2}}, with_null{std::int64_t{1}, Value{}};
    EXPECT_TRUE(database->run("SELECT ?1, ?2", two));
    EXPECT_TRUE(database->run("SELECT ?1, ?2, ?1", with_null));
    EXPECT_FALSE(database->run("SELECT ?1", two));
    EXPECT_FALSE(database->run("SELECT ?1", with_null));
    EXPECT_FALSE(database->run("SELECT ?1, ?2, ?3", two));
    EXPECT_FALSE(database->run("SELECT ?1", {}));
}

TEST_F(AnyDatabase, another_schema_is_no_damage) {
    const Error other = error_of("SELECT nothing FROM nowhere");
    EXPECT_EQ(other.code, ErrorCode::unsupported);
    EXPECT_THAT(other.what, HasSubstr("is no store of this software"));
}

TEST_F(AnyDatabase, a_read_that_takes_too_long_is_ended_and_the_next_has_time_again) {
    const std::string endless =
        "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT count(*) FROM c";
    database->limit_time(std::chrono::milliseconds(5));
    EXPECT_EQ(error_of(endless).code, ErrorCode::timeout);
    database->limit_time(std::chrono::seconds(600));
    EXPECT_EQ(database
                  ->get_integer("WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c LIMIT 100000) SELECT "
                                "count(*) FROM c")
                  .value(),
              100'000);
}

TEST_F(AnyDatabase, a_schema_that_was_edited_calls_no_functions_with_effects) {
    sql("CREATE TABLE t (v); CREATE VIEW w AS SELECT load_extension('x') FROM t; INSERT INTO t VALUES (1)");
    EXPECT_FALSE(database->execute("SELECT * FROM w"));
}

// A function that reads a blob's bytes as a tree is not among those that a schema may call.
TEST_F(AnyDatabase, a_schema_that_was_edited_calls_no_function_that_may_not_be_trusted) {
    sql("CREATE VIEW w AS SELECT rtreedepth(zeroblob(4)) AS d");
    sql("SELECT rtreedepth(zeroblob(4))");
    EXPECT_THAT(error_of("SELECT d FROM w").what, HasSubstr("unsafe use"));
}

TEST(DatabaseFile, that_does_not_exist_is_made_only_by_a_writer) {
    const TempFolder folder;
    const auto file = folder.path() / "none.db";
    for (const auto access : {Database::Access::read, Database::Access::read_at_rest})
        EXPECT_EQ(Database::open(file, access).error().code, ErrorCode::not_found);
    EXPECT_FALSE(std::filesystem::exists(file));
    EXPECT_EQ(Database::open(folder.path() / "no" / "folder.db", Database::Access::create).error().code, ErrorCode::io);
    auto made = Database::open(file, Database::Access::create);
    ASSERT_TRUE(made);
    EXPECT_TRUE((*made)->execute("CREATE TABLE t (v)"));
    EXPECT_EQ((*made)->file(), file);
}

TEST(DatabaseFile, may_have_any_name) {
    for (const char* name : {"plain", "a%20b", "a?mode=memory", "a#b", "a&b=c;d e"}) {
        SCOPED_TRACE(name);
        const TempFolder folder;
        const auto file = folder.path() / name;
        {
            const auto made = Database::open(file, Database::Access::create);
            ASSERT_TRUE(made);
            ASSERT_TRUE((*made)->execute("CREATE TABLE t (v); INSERT INTO t VALUES (7)"));
        }
        const auto read = Database::open(file, Database::Access::read_at_rest);
        ASSERT_TRUE(read);
        EXPECT_EQ((*read)->get_integer("SELECT v FROM t").value_or(0), 7);
    }
}

}  // namespace
}  // namespace hord::firmware::store::test
