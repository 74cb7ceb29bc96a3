#include "firmware/store/results/database.h"

#include <cerrno>
#include <limits>
#include <utility>

#include <sqlite3.h>

#include "common/dangling_link.h"
#include "firmware/store/results/store_rights.h"

namespace hord::firmware::store {
namespace {

constexpr int kBusyMs = 5000;               // another program reads, or a checkpoint runs
constexpr int kMaxValueBytes = 64'000'000;  // of a row; the longest text is a recipe's or a configuration's

// For a file's name inside a URI.
std::string percent_encoded(const std::string& name) {
    std::string out;
    for (const char c : name) {
        if (c == '%') out += "%25";
        else if (c == '?') out += "%3f";
        else if (c == '#') out += "%23";
        else out += c;
    }
    return out;
}

}  // namespace

tl::unexpected<Error> Database::failed(int code) const {
    const std::string name = file_.string();
    const bool told = handle_ != nullptr && sqlite3_errcode(handle_) != SQLITE_OK;
    const std::string detail = told ? sqlite3_errmsg(handle_) : sqlite3_errstr(code);
    const int primary = code & 0xFF, system = handle_ != nullptr ? sqlite3_system_errno(handle_) : 0;
    // The log's index and new files fail with other codes on a full disk.
    const bool no_room =
        (primary == SQLITE_IOERR || primary == SQLITE_CANTOPEN) && (system == ENOSPC || system == EDQUOT);
    switch (no_room ? SQLITE_FULL : primary) {
        case SQLITE_FULL:
            disk_full_ = true;
            return fail(ErrorCode::io, name + " cannot grow: the disk is full",
                        "free space on its disk, or lower store.keep_mb and store.frames_mb, or raise store.free_mb");
        case SQLITE_READONLY:
        case SQLITE_PERM:
            return fail(ErrorCode::io, name + " cannot be written (" + detail + ")", rights_cure(file_.parent_path()));
        case SQLITE_CANTOPEN:
            return fail(ErrorCode::io, name + " cannot be opened (" + detail + ")",
                        "check that its folder exists and that this user may use it");
        case SQLITE_CORRUPT:
        case SQLITE_NOTADB:
        // The statements are fixed: these are errors of values that the store did not write.
        case SQLITE_SCHEMA:
        case SQLITE_MISMATCH:
        case SQLITE_CONSTRAINT:
        case SQLITE_TOOBIG: return damaged(detail);
        case SQLITE_BUSY:
        case SQLITE_LOCKED: return fail(ErrorCode::busy, name + " is locked by another program", "end that program");
        case SQLITE_IOERR:
            return fail(ErrorCode::io, name + " cannot be read or written (" + detail + ")",
                        "check the disk and its cable, and the system's log");
        // Of a schema that the store did not write, or of a statement: the file itself is whole.
        case SQLITE_ERROR:
            return fail(ErrorCode::unsupported, name + " is no store of this software (" + detail + ")",
                        "use the software that wrote it, or move the file, its -wal and its -shm out of the folder; "
                        "else report it");
        case SQLITE_INTERRUPT:
            return fail(ErrorCode::timeout, "reading " + name + " takes too long",
                        "ask for less: a shorter time, fewer rows");
        case SQLITE_NOMEM: return fail(ErrorCode::io, "no memory for " + name, "give the station more memory");
        default: return fail(ErrorCode::internal, name + ": " + detail, "report it");
    }
}

tl::unexpected<Error> Database::damaged(const std::string& detail) const {
    return fail(ErrorCode::unreadable, file_.string() + " is damaged (" + detail + ")",
                "stop the station, move the file, its -wal and its -shm out of the folder and keep them, and start the "
                "station: it begins a new one");
}

// -- statements

Statement::Statement(Statement&& other) noexcept
    : database_(other.database_), statement_(std::exchange(other.statement_, nullptr)) {}
Statement::~Statement() { sqlite3_finalize(statement_); }

Result<void> Statement::bind(std::span<const Value> values) {
    sqlite3_reset(statement_);
    sqlite3_clear_bindings(statement_);
    if (static_cast<std::size_t>(sqlite3_bind_parameter_count(statement_)) != values.size())
        return fail(ErrorCode::internal, std::string("other values than ") + sqlite3_sql(statement_) + " takes",
                    "report it");
    int at = 0;
    for (const Value& value : values) {
        ++at;
        int code = SQLITE_OK;
        if (const auto* integer = std::get_if<std::int64_t>(&value)) {
            code = sqlite3_bind_int64(statement_, at, *integer);
        } else if (const auto* real = std::get_if<double>(&value)) {
            code = sqlite3_bind_double(statement_, at, *real);
        } else if (const auto* text = std::get_if<std::string>(&value)) {
            code = sqlite3_bind_text64(statement_, at, text->data(), text->size(), SQLITE_TRANSIENT, SQLITE_UTF8);
        } else if (const auto* blob = std::get_if<Blob>(&value)) {
            const void* bytes = blob->empty() ? "" : static_cast<const void*>(blob->data());  // null would bind NULL
            code = sqlite3_bind_blob64(statement_, at, bytes, blob->size(), SQLITE_TRANSIENT);
        }
        if (code != SQLITE_OK) return database_->failed(code);
    }
    return {};
}

Result<void> Statement::run(std::span<const Value> values, const Take& take) {
    if (auto bound = bind(values); !bound) return bound;
    int code = SQLITE_OK;
    Result<void> done;
    while (done && (code = sqlite3_step(statement_)) == SQLITE_ROW) {
        if (take) done = take(*this);
    }
    if (done && code != SQLITE_DONE) done = database_->failed(code);  // before the reset, which may clear the message
    sqlite3_reset(statement_);
    sqlite3_clear_bindings(statement_);  // a statement that is kept must not keep long values
    return done;
}

int Statement::columns() const { return sqlite3_column_count(statement_); }

Value Statement::value(int column) const {
    switch (sqlite3_column_type(statement_, column)) {
        case SQLITE_INTEGER: return static_cast<std::int64_t>(sqlite3_column_int64(statement_, column));
        case SQLITE_FLOAT: return sqlite3_column_double(statement_, column);
        case SQLITE_TEXT: {
            std::size_t count = 0;
            const auto* text = static_cast<const char*>(bytes(column, true, count));
            return std::string(text, count);
        }
        case SQLITE_BLOB: {
            std::size_t count = 0;
            const auto* blob = static_cast<const std::uint8_t*>(bytes(column, false, count));
            return Blob(blob, blob + count);
        }
        default: return std::monostate{};
    }
}

// SQLite gives null for an empty blob, and without memory.
const void* Statement::bytes(int column, bool text, std::size_t& count) const {
    const void* start = text ? static_cast<const void*>(sqlite3_column_text(statement_, column))
                             : sqlite3_column_blob(statement_, column);
    count = start == nullptr ? 0 : static_cast<std::size_t>(sqlite3_column_bytes(statement_, column));
    return start == nullptr ? "" : start;
}

tl::unexpected<Error> Statement::wrong_type(int column, const char* written) const {
    constexpr const char* kNames[] = {"of no type", "INTEGER", "REAL", "TEXT", "BLOB", "NULL"};
    const int type = sqlite3_column_type(statement_, column);
    const char* name = sqlite3_column_name(statement_, column);
    return database_->damaged(std::string(name == nullptr ? "a column" : name) + " is " +
                              kNames[type >= 1 && type <= 5 ? type : 0] + ", not " + written);
}

Error Statement::out_of_range(int column) const {
    const char* name = sqlite3_column_name(statement_, column);
    return database_->damaged(std::string(name == nullptr ? "a column" : name) + " is out of range").value();
}

bool Statement::is(int column, int type) const { return sqlite3_column_type(statement_, column) == type; }

std::string_view Statement::text_of(int column) const {
    std::size_t count = 0;
    const auto* start = static_cast<const char*>(bytes(column, true, count));
    return {start, count};
}

Result<std::int64_t> Statement::integer(int column) const {
    if (!is(column, SQLITE_INTEGER)) return wrong_type(column, "INTEGER");
    return static_cast<std::int64_t>(sqlite3_column_int64(statement_, column));
}

Result<std::string> Statement::text(int column) const {
    if (!is(column, SQLITE_TEXT)) return wrong_type(column, "TEXT");
    return std::string(text_of(column));
}

Result<std::optional<std::int64_t>> Statement::integer_or_null(int column) const {
    if (is(column, SQLITE_NULL)) return std::nullopt;
    return integer(column).map([](std::int64_t read) { return std::optional(read); });
}

// -- rows of many columns: no Result for a value that is as it should be

void RowReader::keep(Error error) {
    if (!error_) error_ = std::move(error);
}

std::int64_t RowReader::integer(int column) {
    if (row_.is(column, SQLITE_INTEGER)) return sqlite3_column_int64(row_.statement_, column);
    keep(row_.wrong_type(column, "INTEGER").value());
    return 0;
}

std::string RowReader::text(int column) {
    if (row_.is(column, SQLITE_TEXT)) return std::string(row_.text_of(column));
    keep(row_.wrong_type(column, "TEXT").value());
    return {};
}

std::optional<std::int64_t> RowReader::integer_or_null(int column) {
    return row_.is(column, SQLITE_NULL) ? std::nullopt : std::optional(integer(column));
}

std::optional<double> RowReader::real_or_null(int column) {
    if (row_.is(column, SQLITE_NULL)) return std::nullopt;
    if (row_.is(column, SQLITE_FLOAT)) return sqlite3_column_double(row_.statement_, column);
    keep(row_.wrong_type(column, "REAL").value());
    return std::nullopt;
}

std::uint32_t RowReader::natural(int column) {
    const std::int64_t read = integer(column);
    if (read >= 0 && read <= std::numeric_limits<std::uint32_t>::max()) return static_cast<std::uint32_t>(read);
    keep(row_.out_of_range(column));
    return 0;
}

std::string RowReader::text_or_empty(int column) const {
    return row_.is(column, SQLITE_TEXT) ? std::string(row_.text_of(column)) : std::string();
}

// -- the connection

Result<std::unique_ptr<Database>> Database::open(const std::filesystem::path& file, Access access,
                                                 const std::string& vfs) {
    if (access != Access::create) {
        std::error_code error;
        if (!std::filesystem::exists(file, error) && vfs.empty()) {
            const std::string link = common::dangling_link(file);
            return fail(ErrorCode::not_found, link.empty() ? file.string() + " does not exist" : link,
                        "name the folder of a station's store");
        }
    }
    if (auto fine = check_database_files(file); !fine) return tl::unexpected(fine.error());
    std::unique_ptr<Database> database(new Database(file));
    int flags = SQLITE_OPEN_NOMUTEX;
    flags |= access == Access::create ? SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE : SQLITE_OPEN_READONLY;
    std::string name = file.string();
    if (access == Access::read_at_rest) {
        flags |= SQLITE_OPEN_URI;
        std::error_code error;
        const std::filesystem::path whole = std::filesystem::absolute(file, error);
        if (error) return database->failed(SQLITE_CANTOPEN);
        name = "file:" + percent_encoded(whole.string()) + "?immutable=1";
    }
    const int code = sqlite3_open_v2(name.c_str(), &database->handle_, flags, vfs.empty() ? nullptr : vfs.c_str());
    if (code != SQLITE_OK) return database->failed(code);
    // SQLite opens a file that this user may not write to be read, and would tell so at the first result.
    if (access == Access::create && sqlite3_db_readonly(database->handle_, "main") == 1)
        return database->failed(SQLITE_READONLY);
    sqlite3_busy_timeout(database->handle_, kBusyMs);
    // A damaged length must not take all memory, and a schema that somebody edited must not call functions.
    sqlite3_limit(database->handle_, SQLITE_LIMIT_LENGTH, kMaxValueBytes);
    sqlite3_db_config(database->handle_, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
    return database;
}

void Database::limit_time(std::chrono::milliseconds most) {
    constexpr int kInstructions = 10'000;  // SQLite instructions between two checks of the time: 1 ms at most
    until_ = std::chrono::steady_clock::now() + most;
    sqlite3_progress_handler(
        handle_, kInstructions,
        [](void* self) { return std::chrono::steady_clock::now() > static_cast<Database*>(self)->until_ ? 1 : 0; },
        this);
}

Database::~Database() {
    idle_.clear();
    sqlite3_close_v2(handle_);
}

Result<Statement> Database::prepare(std::string_view sql) {
    sqlite3_stmt* statement = nullptr;
    const int code = sqlite3_prepare_v3(handle_, sql.data(), static_cast<int>(sql.size()), SQLITE_PREPARE_PERSISTENT,
                                        &statement, nullptr);
    if (code != SQLITE_OK) return failed(code);
    return Statement(*this, statement);
}

Result<void> Database::execute(const std::string& sql) {
    const int code = sqlite3_exec(handle_, sql.c_str(), nullptr, nullptr, nullptr);
    if (code != SQLITE_OK) return failed(code);
    return {};
}

Result<void> Database::run(std::string_view sql, std::span<const Value> values, const Statement::Take& take) {
    // What runs is taken out, so that `take` may run the same text.
    const auto known = idle_.find(sql);
    auto statement = known == idle_.end() ? prepare(sql) : Result<Statement>(std::move(known->second));
    if (known != idle_.end()) idle_.erase(known);
    if (!statement) return tl::unexpected(statement.error());
    auto done = statement->run(values, take);
    if (idle_.size() >= kMaxIdle) idle_.clear();
    idle_.emplace(sql, std::move(*statement));
    return done;
}

Result<Value> Database::get(std::string_view sql, std::span<const Value> values) {
    Value value;
    const auto take = [&](const Statement& row) -> Result<void> {
        value = row.value(0);
        return {};
    };
    return run(sql, values, take).map([&] { return std::move(value); });
}

Result<std::int64_t> Database::get_integer(std::string_view sql, std::span<const Value> values) {
    std::int64_t value = 0;
    const auto take = [&](const Statement& row) {
        return row.integer_or_null(0).map([&](std::optional<std::int64_t> read) { value = read.value_or(0); });
    };
    return run(sql, values, take).map([&] { return value; });
}

Result<std::string> Database::get_text(std::string_view sql, std::span<const Value> values) {
    std::string value;
    const auto take = [&](const Statement& row) -> Result<void> {
        if (std::holds_alternative<std::monostate>(row.value(0))) return {};
        return row.text(0).map([&](std::string read) { value = std::move(read); });
    };
    return run(sql, values, take).map([&] { return std::move(value); });
}

// -- transactions

Result<Transaction> Transaction::begin(Database& database) {
    if (auto done = database.execute("BEGIN IMMEDIATE"); !done) return tl::unexpected(done.error());
    return Transaction(database);
}

Result<void> Transaction::commit() {
    if (auto done = database_->execute("COMMIT"); !done) return done;
    database_ = nullptr;
    return {};
}

Transaction::~Transaction() {
    if (database_ != nullptr) (void)database_->execute("ROLLBACK");
}

}  // namespace hord::firmware::store
