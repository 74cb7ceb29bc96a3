// A thin layer over SQLite: connection, prepared statements, transactions.
//
// One thread at a time. Every error names the file and the cure (full disk, read-only, damaged). No call throws for
// what a file holds: a value of another type than it was written with is an error `unreadable`.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "common/result.h"

struct sqlite3;
struct sqlite3_stmt;

namespace hord::firmware::store {

using Blob = std::vector<std::uint8_t>;
using Value = std::variant<std::monostate, std::int64_t, double, std::string, Blob>;  // NULL, INTEGER, REAL, TEXT, BLOB

class Database;

// A prepared statement. Must be destroyed before its database.
class Statement {
  public:
    Statement(Statement&& other) noexcept;
    Statement& operator=(Statement&&) = delete;
    ~Statement();

    // Reads the current row. An error ends the run and is its result.
    using Take = std::function<Result<void>(const Statement&)>;
    // Binds ?1, ?2 ... and runs the statement to its end.
    Result<void> run(std::span<const Value> values, const Take& take = {});

    // Of the current row. The typed ones fail with unreadable for a value of another type; NULL is one.
    [[nodiscard]] int columns() const;
    [[nodiscard]] Value value(int column) const;
    [[nodiscard]] Result<std::int64_t> integer(int column) const;
    [[nodiscard]] Result<std::string> text(int column) const;
    [[nodiscard]] Result<std::optional<std::int64_t>> integer_or_null(int column) const;
    [[nodiscard]] Error out_of_range(int column) const;  // for an integer that cannot have been written

  private:
    friend class Database;
    friend class RowReader;
    Statement(Database& database, sqlite3_stmt* statement) : database_(&database), statement_(statement) {}
    Result<void> bind(std::span<const Value> values);
    [[nodiscard]] bool is(int column, int type) const;  // SQLITE_INTEGER, ...
    [[nodiscard]] tl::unexpected<Error> wrong_type(int column, const char* written) const;
    [[nodiscard]] std::string_view text_of(int column) const;
    [[nodiscard]] const void* bytes(int column, bool text, std::size_t& count) const;
    Database* database_;
    sqlite3_stmt* statement_;
};

// Reads several columns of a row and keeps the first error, for rows of many columns. An unreadable column gives 0 or
// an empty text.
class RowReader {
  public:
    explicit RowReader(const Statement& row) : row_(row) {}
    std::int64_t integer(int column);
    std::string text(int column);
    std::optional<std::int64_t> integer_or_null(int column);
    std::optional<double> real_or_null(int column);
    std::uint32_t natural(int column);                          // 0 to 2^32 - 1
    [[nodiscard]] std::string text_or_empty(int column) const;  // empty for other types, which are no error
    [[nodiscard]] const std::optional<Error>& error() const { return error_; }

  private:
    void keep(Error error);
    const Statement& row_;
    std::optional<Error> error_;
};

class Database {
  public:
    // read_at_rest: no other process writes while it is open; makes no files and takes no lock.
    enum class Access : std::uint8_t { read, read_at_rest, create };

    // `vfs`: SQLite VFS, for tests; empty: the system's. Fails with not_found, unreadable (damaged, or
    // not a database), io (no permission, full disk).
    static Result<std::unique_ptr<Database>> open(const std::filesystem::path& file, Access access,
                                                  const std::string& vfs = {});
    ~Database();
    Database(const Database&) = delete;
    Database& operator=(const Database&) = delete;

    Result<Statement> prepare(std::string_view sql);
    Result<void> execute(const std::string& sql);  // one or more statements, rows ignored
    // Keeps the prepared statement for the next run of the same text: to parse a query of results takes longer than to
    // answer it. `take` may run statements, too.
    Result<void> run(std::string_view sql, std::span<const Value> values, const Statement::Take& take = {});
    // For statements with one row at most: its first value. Without a row, and for NULL: NULL, 0, an empty text. Fail
    // with unreadable for a value of another type.
    Result<Value> get(std::string_view sql, std::span<const Value> values = {});
    Result<std::int64_t> get_integer(std::string_view sql, std::span<const Value> values = {});
    Result<std::string> get_text(std::string_view sql, std::span<const Value> values = {});

    // Error `unreadable`: the file is damaged, and how (`detail`); with the cure.
    [[nodiscard]] tl::unexpected<Error> damaged(const std::string& detail) const;

    // From now on, statements fail with timeout after `most`.
    void limit_time(std::chrono::milliseconds most);

    [[nodiscard]] const std::filesystem::path& file() const { return file_; }
    [[nodiscard]] bool disk_full() const { return disk_full_; }  // an operation failed for that reason

  private:
    friend class Statement;
    [[nodiscard]] tl::unexpected<Error> failed(int code) const;
    explicit Database(std::filesystem::path file) : file_(std::move(file)) {}
    std::filesystem::path file_;
    sqlite3* handle_ = nullptr;
    static constexpr std::size_t kMaxIdle = 16;                // of all that are run, verify() has the most: 11
    std::map<std::string, Statement, std::less<>> idle_ = {};  // by their text; those that run are not here
    std::chrono::steady_clock::time_point until_{};
    mutable bool disk_full_ = false;
};

// Rolls back unless committed.
class Transaction {
  public:
    static Result<Transaction> begin(Database& database);
    Transaction(Transaction&& other) noexcept : database_(std::exchange(other.database_, nullptr)) {}
    Transaction& operator=(Transaction&&) = delete;
    ~Transaction();
    // Durable when it returns. After a failure either nothing has changed or, if the sync failed, everything.
    Result<void> commit();

  private:
    explicit Transaction(Database& database) : database_(&database) {}
    Database* database_;
};

}  // namespace hord::firmware::store
