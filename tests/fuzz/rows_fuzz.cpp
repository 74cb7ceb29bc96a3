// Values of any type in the columns of a store's row: [column, type, length, bytes...]. The row is read, shown as JSON,
// CSV and text, and says that it is damaged where a value has not its column's type. The rows beside it are read as
// they were written. One input of 16, by its length, is verified, too: that takes most of the time.
#include <array>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>

#include <sqlite3.h>

#include "firmware/store/results/export.h"
#include "tests/firmware/store/results/samples.h"

namespace {

using namespace hord;
using namespace hord::firmware::store;

// A store whose tables are not strict any more.
struct Store {
    test::TempFolder folder;
    sqlite3* handle = nullptr;
    std::vector<std::string> columns;
    std::vector<sqlite3_stmt*> updates;    // one a column
    std::array<sqlite3_stmt*, 3> begin{};  // the row as it was written, under whatever number an input left it
    sqlite3_stmt* commit = nullptr;
    std::unique_ptr<StoreReader> reader;
    std::vector<StoredResult> written;

    Store() {
        // Both connections are of this thread, and nobody asks how much memory they take.
        if (sqlite3_config(SQLITE_CONFIG_SINGLETHREAD) != SQLITE_OK ||
            sqlite3_config(SQLITE_CONFIG_MEMSTATUS, 0) != SQLITE_OK)
            std::abort();
        test::write(folder,
                    test::Story(test::start(7)).add(test::recipe("lens", "name = \"lens\"\n")).add_results(1, 3));
        const std::string file = (folder.path() / kStoreFile).string();
        if (sqlite3_open(file.c_str(), &handle) != SQLITE_OK) std::abort();
        sqlite3_db_config(handle, SQLITE_DBCONFIG_DEFENSIVE, 0, nullptr);
        run("PRAGMA writable_schema = ON; UPDATE sqlite_schema SET sql = replace(sql, 'STRICT', '') WHERE type = "
            "'table';");
        run("PRAGMA writable_schema = RESET; PRAGMA synchronous = OFF;");
        sqlite3_exec(
            handle, "SELECT name FROM pragma_table_info('results')",
            [](void* to, int, char** values, char**) {
                static_cast<std::vector<std::string>*>(to)->emplace_back(values[0]);
                return 0;
            },
            &columns, nullptr);
        run("CREATE TEMP TABLE whole AS SELECT * FROM results;");
        for (const std::string& column : columns)
            updates.push_back(prepared("UPDATE results SET " + column + " = ? WHERE number = 2"));
        begin = {prepared("BEGIN"), prepared("DELETE FROM results WHERE number NOT IN (1, 3)"),
                 prepared("INSERT INTO results SELECT * FROM whole WHERE number = 2")};
        commit = prepared("COMMIT");
        reader = std::move(*StoreReader::open(folder.path()));
        (void)reader->each_result({}, [&](const StoredResult& row) { written.push_back(row); });
        if (written.size() != 3) std::abort();
        set(7, 3, "a blob");  // what this target relies on: a row that says that it is damaged
        std::size_t damaged = 0;
        (void)reader->each_result({}, [&](const StoredResult& row) { damaged += row.damage.empty() ? 0 : 1; });
        if (damaged != 1) std::abort();
    }
    sqlite3_stmt* prepared(const std::string& sql) {
        sqlite3_stmt* statement = nullptr;
        if (sqlite3_prepare_v2(handle, sql.c_str(), -1, &statement, nullptr) != SQLITE_OK) std::abort();
        return statement;
    }
    static void step(sqlite3_stmt* statement) {
        sqlite3_step(statement);
        sqlite3_reset(statement);
    }
    void run(const char* sql) { (void)sqlite3_exec(handle, sql, nullptr, nullptr, nullptr); }
    void set(unsigned column, unsigned type, std::string_view bytes) {
        sqlite3_stmt* statement = updates.at(column % updates.size());
        std::int64_t whole = 0;
        std::memcpy(&whole, bytes.data(), std::min(bytes.size(), sizeof whole));
        switch (type % 5) {
            case 0: sqlite3_bind_int64(statement, 1, whole); break;
            case 1: sqlite3_bind_double(statement, 1, static_cast<double>(whole) / 7); break;
            case 2:
                sqlite3_bind_text(statement, 1, bytes.data(), static_cast<int>(bytes.size()), SQLITE_TRANSIENT);
                break;
            case 3:
                sqlite3_bind_blob(statement, 1, bytes.data(), static_cast<int>(bytes.size()), SQLITE_TRANSIENT);
                break;
            default: sqlite3_bind_null(statement, 1);
        }
        step(statement);
    }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static Store store;
    for (sqlite3_stmt* const statement : store.begin) Store::step(statement);
    std::string_view rest(reinterpret_cast<const char*>(data), size);
    while (rest.size() >= 3) {
        const auto length = std::min<std::size_t>(static_cast<std::uint8_t>(rest[2]), rest.size() - 3);
        store.set(static_cast<std::uint8_t>(rest[0]), static_cast<std::uint8_t>(rest[1]), rest.substr(3, length));
        rest.remove_prefix(3 + length);
    }
    Store::step(store.commit);
    std::size_t rows = 0;
    const auto done = store.reader->each_result({}, [&](const StoredResult& row) {
        ++rows;
        if (row.number == 1 || row.number == 3) {
            if (row != store.written[static_cast<std::size_t>(row.number - 1)]) std::abort();
        } else if (to_csv(row).empty() || to_line(to_json(row)).empty() || to_table(row).empty()) {
            std::abort();
        }
    });
    if (done ? rows != store.written.size() : done.error().code == ErrorCode::internal) std::abort();
    if (size % 16 != 0) return 0;
    if (const auto checked = store.reader->verify(); !checked && checked.error().code == ErrorCode::internal)
        std::abort();
    return 0;
}
