// Reads and edits a store with plain SQL, as a person with the sqlite3 tool can.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include <sqlite3.h>

#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::store::test {

inline void sql(const std::filesystem::path& folder, const std::string& statements) {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open((folder / "results.db").c_str(), &db), SQLITE_OK);
    char* why = nullptr;
    EXPECT_EQ(sqlite3_exec(db, statements.c_str(), nullptr, nullptr, &why), SQLITE_OK)
        << (why != nullptr ? why : "") << " in " << statements;
    sqlite3_free(why);
    sqlite3_close(db);
}
inline void sql(const TempFolder& folder, const std::string& statements) { sql(folder.path(), statements); }

// The tables as older software made them: neither STRICT nor NOT NULL refuses an edit.
inline void loosen(const TempFolder& folder) {
    sql(folder,
        "PRAGMA writable_schema = ON; UPDATE sqlite_schema SET sql = replace(replace(replace(sql, ') STRICT, WITHOUT', "
        "') WITHOUT'), ') STRICT', ')'), ' NOT NULL', '') WHERE type = 'table'; PRAGMA writable_schema = RESET");
}

inline std::uintmax_t sql_integer(const TempFolder& folder, const std::string& query) {
    sqlite3* db = nullptr;
    EXPECT_EQ(sqlite3_open((folder.path() / "results.db").c_str(), &db), SQLITE_OK);
    sqlite3_stmt* statement = nullptr;
    EXPECT_EQ(sqlite3_prepare_v2(db, query.c_str(), -1, &statement, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
    EXPECT_EQ(sqlite3_step(statement), SQLITE_ROW);
    const auto value = static_cast<std::uintmax_t>(sqlite3_column_int64(statement, 0));
    sqlite3_finalize(statement);
    sqlite3_close(db);
    return value;
}

}  // namespace hord::firmware::store::test
