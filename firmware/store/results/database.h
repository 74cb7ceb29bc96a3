// A thin layer over SQLite: connection, prepared statements, transactions.
//
// One thread at a time. Every error names the file and the cure (full disk, read-only, damaged).
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
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

    // Binds ?1, ?2 ... and runs the statement to its end; `take` reads the current row.
    Result<void> run(std::span<const Value> values, const std::function<void(const Statement&)>& take = {});

    // Of the current row.
    [[nodiscard]] int columns() const;
    [[nodiscard]] Value value(int column) const;
    [[nodiscard]] std::int64_t integer(int column) const;  // 0 for other types
    [[nodiscard]] std::string text(int column) const;      // empty for other types

  private:
    friend class Database;
    Statement(Database& database, sqlite3_stmt* statement) : database_(&database), statement_(statement) {}
    Result<void> bind(std::span<const Value> values);
    Database* database_;
    sqlite3_stmt* statement_;
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
    Result<void> run(std::string_view sql, std::span<const Value> values,
                     const std::function<void(const Statement&)>& take = {});
    // For statements with one row at most: its first value; NULL and 0 without a row.
    Result<Value> get(std::string_view sql, std::span<const Value> values = {});
    Result<std::int64_t> get_integer(std::string_view sql, std::span<const Value> values = {});

    // From now on, statements fail with timeout after `most`.
    void limit_time(std::chrono::milliseconds most);

    [[nodiscard]] const std::filesystem::path& file() const { return file_; }

  private:
    friend class Statement;
    [[nodiscard]] tl::unexpected<Error> failed(int code) const;
    explicit Database(std::filesystem::path file) : file_(std::move(file)) {}
    std::filesystem::path file_;
    sqlite3* handle_ = nullptr;
    std::chrono::steady_clock::time_point until_{};
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
