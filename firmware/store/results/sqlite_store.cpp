#include "firmware/store/results/sqlite_store.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <random>
#include <ranges>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include "common/unique_fd.h"
#include "firmware/store/results/database.h"
#include "firmware/store/results/hash_chain.h"
#include "firmware/store/results/records.h"
#include "firmware/store/results/schema.h"

namespace hord::firmware::store {
namespace {

namespace fs = std::filesystem;

// One writer a store: a lock of the process (flock), which ends with it even when it is killed.
Result<common::UniqueFd> lock_folder(const fs::path& folder) {
    const fs::path file = folder / "lock";
    common::UniqueFd fd(open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
    if (!fd) {
        return fail(ErrorCode::io, file.string() + " cannot be written (" + std::strerror(errno) + ")",
                    "give the station's user the right to write its folder, and see that its disk has space and is "
                    "not mounted read-only");
    }
    if (flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
        return fail(ErrorCode::busy, folder.string() + " is written by another program",
                    "give each station a store.folder of its own");
    }
    return fd;
}

std::string random_id() {
    std::random_device random;
    std::array<std::uint8_t, 16> bytes{};
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
    return to_hex(bytes);
}

// Appends rows to one chain.
class HashChain {
  public:
    static Result<HashChain> open(Database& database, const ChainTable& table, const std::string& store_id) {
        const std::vector<std::string_view> places(table.columns.size() + 1, "?");
        auto insert = database.prepare(fmt::format("INSERT INTO {} VALUES ({})", table.name, fmt::join(places, ", ")));
        if (!insert) return tl::unexpected(insert.error());
        auto set_head = database.prepare("INSERT OR REPLACE INTO heads VALUES (?1, ?2, ?3)");
        if (!set_head) return tl::unexpected(set_head.error());
        HashChain chain(table, std::move(*insert), std::move(*set_head));
        chain.hash_ = genesis(store_id, table.name);
        const std::array<Value, 1> name{std::string(table.name)};
        auto number = database.get_integer("SELECT number FROM heads WHERE chain = ?1", name);
        auto hash = database.get("SELECT hash FROM heads WHERE chain = ?1", name);
        auto newest = database.get_integer(fmt::format("SELECT max(number) FROM {}", table.name));
        if (!number) return tl::unexpected(number.error());
        if (!hash) return tl::unexpected(hash.error());
        if (!newest) return tl::unexpected(newest.error());
        // Rows and head differ only if the file was edited: continue above both; verify reports it.
        chain.number_ = std::max(*number, *newest);
        if (const auto* blob = std::get_if<Blob>(&*hash); blob != nullptr && blob->size() == chain.hash_.size()) {
            std::copy(blob->begin(), blob->end(), chain.hash_.begin());
        }
        return chain;
    }

    [[nodiscard]] std::int64_t next_number() const { return number_ + 1; }

    Result<void> append(std::int64_t run, std::uint64_t entry, UtcMicros time_us, std::vector<Value> rest) {
        ++number_;
        std::vector<Value> row{number_, std::int64_t{kSchemaVersion}, run, static_cast<std::int64_t>(entry), time_us};
        std::move(rest.begin(), rest.end(), std::back_inserter(row));
        hash_ = follow(hash_, row);
        row.push_back(to_value(hash_));
        touched_ = true;
        return insert_.run(row);
    }

    // Before every commit.
    Result<void> write_head() {
        if (!std::exchange(touched_, false)) return {};
        return set_head_.run(std::array<Value, 3>{std::string(table_->name), number_, to_value(hash_)});
    }

  private:
    HashChain(const ChainTable& table, Statement insert, Statement set_head)
        : table_(&table), insert_(std::move(insert)), set_head_(std::move(set_head)) {}
    const ChainTable* table_;
    Statement insert_, set_head_;
    std::int64_t number_ = 0;
    Hash hash_{};
    bool touched_ = false;
};

// The change in use of one kind; the following results refer to it.
struct InUse {
    std::int64_t number = 0;  // 0: none
    std::string after;
    [[nodiscard]] Value reference() const { return number == 0 ? Value{} : Value(number); }
};

class SqliteStore final : public ResultStore {
  public:
    SqliteStore(common::UniqueFd lock, const SqliteStoreOptions& options, std::unique_ptr<Database> database)
        : lock_(std::move(lock)), options_(options), database_(std::move(database)) {}
    // Migrates the file and reads the changes in use.
    Result<void> prepare();

    Result<void> write(std::span<const Entry> entries) override;
    Result<bool> prune(const Retention& retention, UtcMicros now_us) override;

  private:
    Result<void> store(std::uint64_t entry, const StartRecord& start);
    Result<void> store(std::uint64_t entry, const ChangeRecord& change);
    Result<void> store(std::uint64_t entry, const ResultRecord& result) {
        return results_->append(run_, entry, result.time_us,
                                values_of(result, in_use(ChangeRecord::What::recipe).reference(),
                                          in_use(ChangeRecord::What::calibration).reference()));
    }
    Result<void> store(std::uint64_t /*entry*/, const AcknowledgeRecord& acknowledge) {
        return database_->run(
            "INSERT OR REPLACE INTO acknowledged VALUES (?1, ?2, ?3, ?4)",
            std::array<Value, 4>{run_, std::int64_t{acknowledge.sequence}, acknowledge.time_us, acknowledge.peer});
    }
    Result<void> close_batch(Transaction& transaction);
    Result<bool> prune(const ChainTable& table, const Retention& retention, UtcMicros now_us);
    InUse& in_use(ChangeRecord::What what) { return in_use_[static_cast<std::size_t>(what)]; }

    common::UniqueFd lock_;
    const SqliteStoreOptions options_;
    const std::unique_ptr<Database> database_;
    std::optional<HashChain> results_, commands_, changes_;
    bool broken_ = false;

    std::int64_t run_ = 0;
    bool adopted_ = false;           // the run was in the file already: it was opened again after an error
    std::uint64_t last_entry_ = 0;   // of this run
    std::array<InUse, 3> in_use_{};  // by ChangeRecord::What: recipe, configuration, calibration
};

// -- opening

Result<void> SqliteStore::prepare() {
    const auto age = check_schema(*database_);
    if (!age) return tl::unexpected(age.error());
    if (*age == Age::empty) {
        // auto_vacuum sets the layout of the file: it must be the first statement.
        if (auto done = database_->execute("PRAGMA auto_vacuum = INCREMENTAL"); !done) return done;
    }
    // Bounds the write-ahead log: a checkpoint every 1000 pages (SQLite's default), and 16 MB after a burst.
    if (auto done = database_->execute(
            "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA journal_size_limit = 16777216; "
            "PRAGMA temp_store = MEMORY");
        !done) {
        return done;
    }
    if (*age == Age::empty) {
        if (auto done = create_schema(*database_, random_id()); !done) return done;
    }
    const auto id = read_store_id(*database_);
    if (!id) return tl::unexpected(id.error());
    // Begun even without a migration: a store that cannot be written fails here.
    auto transaction = Transaction::begin(*database_);
    if (!transaction) return tl::unexpected(transaction.error());
    int from = kSchemaVersion;
    if (*age == Age::older) {
        const auto migrated = migrate_schema(*database_);
        if (!migrated) return tl::unexpected(migrated.error());
        from = *migrated;
    }
    for (auto [chain, table] :
         {std::pair(&results_, &kResults), std::pair(&commands_, &kCommands), std::pair(&changes_, &kChanges)}) {
        auto opened = HashChain::open(*database_, *table, *id);
        if (!opened) return tl::unexpected(opened.error());
        chain->emplace(std::move(*opened));
    }
    for (std::size_t k = 0; k < in_use_.size(); ++k) {
        const std::array<Value, 1> what{std::string(name_of(static_cast<ChangeRecord::What>(k)))};
        const auto done =
            database_->run("SELECT number, after FROM changes WHERE what = ?1 ORDER BY number DESC LIMIT 1", what,
                           [&](const Statement& row) {
                               in_use_[k] = {row.integer(0), row.text(1)};
                           });
        if (!done) return done;
    }
    if (from == kSchemaVersion) return {};
    const std::vector<Value> row{std::string("migration"), std::string(),        std::int64_t{0},
                                 std::string("schema"),    std::to_string(from), std::to_string(kSchemaVersion)};
    if (auto done = changes_->append(0, 0, 0, row); !done) return done;
    return close_batch(*transaction);
}

// -- writing

Result<void> SqliteStore::write(std::span<const Entry> entries) {
    if (broken_) return fail(ErrorCode::internal, "the store failed before", "open it again");
    broken_ = true;
    auto transaction = Transaction::begin(*database_);
    if (!transaction) return tl::unexpected(transaction.error());
    for (const Entry& entry : entries) {
        if (entry.number != 0 && entry.number <= last_entry_) continue;
        auto done = std::visit([&](const auto& record) { return store(entry.number, record); }, entry.record);
        if (!done) return done;
        if (entry.number != 0) last_entry_ = entry.number;
    }
    if (auto done = close_batch(*transaction); !done) return done;
    broken_ = false;
    return {};
}

Result<void> SqliteStore::close_batch(Transaction& transaction) {
    for (std::optional<HashChain>* chain : {&results_, &commands_, &changes_}) {
        if (auto done = (*chain)->write_head(); !done) return done;
    }
    return transaction.commit();
}

// A run that the file already has continues: the store was opened again after an error.
Result<void> SqliteStore::store(std::uint64_t entry, const StartRecord& start) {
    std::string before;
    last_entry_ = 0;
    adopted_ = false;
    const auto read =
        database_->run("SELECT number, time_us, after FROM changes WHERE what = 'start' ORDER BY number DESC LIMIT 1",
                       {}, [&](const Statement& row) {
                           run_ = row.integer(0);
                           before = row.text(2);
                           adopted_ = row.integer(1) == start.time_us && before == to_json_line(start);
                       });
    if (!read) return read;
    if (!adopted_) {
        run_ = changes_->next_number();
        return changes_->append(run_, entry, start.time_us, values_of(start, before));
    }
    for (const char* sql : {"SELECT iif(run = ?1, entry, 0) FROM results ORDER BY number DESC LIMIT 1",
                            "SELECT iif(run = ?1, entry, 0) FROM commands ORDER BY number DESC LIMIT 1",
                            "SELECT max(entry) FROM changes WHERE run = ?1"}) {
        const auto last = database_->get_integer(sql, std::array<Value, 1>{run_});
        if (!last) return tl::unexpected(last.error());
        last_entry_ = std::max(last_entry_, static_cast<std::uint64_t>(*last));
    }
    return {};
}

Result<void> SqliteStore::store(std::uint64_t entry, const ChangeRecord& change) {
    if (change.what == ChangeRecord::What::command)
        return commands_->append(run_, entry, change.time_us, values_of(change));
    if (change.what == ChangeRecord::What::lost)
        return changes_->append(run_, entry, change.time_us, values_of(change));
    if (entry == 0 && adopted_) return {};  // the file may have more entries than were reported to the writer
    InUse& now = in_use(change.what);
    if (change.if_new && now.number != 0 && now.after == change.after) return {};
    ChangeRecord written = change;
    if (change.if_new) written.before = now.after;
    now = {changes_->next_number(), change.after};
    return changes_->append(run_, entry, change.time_us, values_of(written));
}

// -- retention

Result<bool> SqliteStore::prune(const Retention& retention, UtcMicros now_us) {
    if (broken_) return fail(ErrorCode::internal, "the store failed before", "open it again");
    broken_ = true;
    bool more = false;
    for (const ChainTable* table : {&kResults, &kCommands}) {
        const auto done = prune(*table, retention, now_us);
        if (!done) return done;
        more = more || *done;
    }
    // Returns free pages to the file system, a few at a time.
    if (auto done = database_->execute("PRAGMA incremental_vacuum(4096)"); !done) return tl::unexpected(done.error());
    broken_ = false;
    return more;
}

Result<bool> SqliteStore::prune(const ChainTable& table, const Retention& retention, UtcMicros now_us) {
    const std::string name(table.name);
    std::array<std::int64_t, 5> known{};
    const std::array<std::string, 5> questions{"SELECT min(number) FROM " + name, "SELECT max(number) FROM " + name,
                                               "PRAGMA page_count", "PRAGMA freelist_count", "PRAGMA page_size"};
    for (std::size_t k = 0; k < known.size(); ++k) {
        const auto answer = database_->get_integer(questions[k]);
        if (!answer) return tl::unexpected(answer.error());
        known[k] = *answer;
    }
    const auto [first, last, pages, free_pages, page_size] = known;
    if (first >= last) return false;  // the newest row stays, so that the chain can go on from it

    // By age: all rows before the first one that is young enough. If the clock was set back, rows are kept longer.
    std::int64_t remove_to = first - 1;
    bool more = false;
    const std::int64_t furthest = std::min(last - 1, first + options_.rows_in_one_prune - 1);
    if (retention.keep_us > 0) {
        // The unary + keeps SQLite from the index by time: the rows are read in order, and only the old ones.
        const auto young = database_->get_integer(
            "SELECT number FROM " + name + " WHERE number <= ?1 AND +time_us >= ?2 ORDER BY number LIMIT 1",
            std::array<Value, 2>{furthest, now_us - retention.keep_us});
        if (!young) return tl::unexpected(young.error());
        remove_to = *young == 0 ? furthest : *young - 1;
        more = remove_to == furthest && furthest < last - 1;
    }
    // By size: the share of the rows above the limit, and 1 % more, so that not every call has to remove rows.
    const auto used = static_cast<double>((pages - free_pages) * page_size);
    if (retention.max_bytes > 0 && used > static_cast<double>(retention.max_bytes)) {
        const double share = std::min(1.0, (used - static_cast<double>(retention.max_bytes)) / used + 0.01);
        const auto wanted = first + static_cast<std::int64_t>(share * static_cast<double>(last - first + 1));
        remove_to = std::max(remove_to, std::min(furthest, wanted));
        more = more || wanted > furthest;
    }
    if (remove_to < first) return false;

    auto transaction = Transaction::begin(*database_);
    if (!transaction) return tl::unexpected(transaction.error());
    const std::array<Value, 1> to{remove_to};
    const auto hash = database_->get("SELECT hash FROM " + name + " WHERE number = ?1", to);
    if (!hash) return tl::unexpected(hash.error());
    const auto* bytes = std::get_if<Blob>(&*hash);
    // verify needs this row when the chain begins after row 1.
    const std::string what =
        to_text({{"from", first}, {"to", remove_to}, {"hash", bytes != nullptr ? to_hex(*bytes) : ""}});
    const std::vector<Value> row{std::string("retention"), std::string(), std::int64_t{0}, name, std::string(), what};
    return database_->run("DELETE FROM " + name + " WHERE number <= ?1", to)
        .and_then([&] { return changes_->append(run_, 0, now_us, row); })
        .and_then([&] { return close_batch(*transaction); })
        .map([&] { return more; });
}

}  // namespace

Result<std::unique_ptr<ResultStore>> open_sqlite_store(const fs::path& folder, const SqliteStoreOptions& options) {
    std::error_code error;
    fs::create_directory(folder, error);
    if (!fs::is_directory(folder)) {
        return fail(ErrorCode::io,
                    "the folder " + folder.string() + " cannot be made" + (error ? " (" + error.message() + ")" : ""),
                    "create it and give it to the station's user (store.folder)");
    }
    auto lock = lock_folder(folder);
    if (!lock) return tl::unexpected(lock.error());
    auto database = Database::open(folder / kStoreFile, Database::Access::create, options.vfs);
    if (!database) return tl::unexpected(database.error());
    auto store = std::make_unique<SqliteStore>(std::move(*lock), options, std::move(*database));
    if (auto done = store->prepare(); !done) return tl::unexpected(done.error());
    return std::unique_ptr<ResultStore>(std::move(store));
}

}  // namespace hord::firmware::store
