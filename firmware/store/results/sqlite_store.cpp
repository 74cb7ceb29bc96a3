#include "firmware/store/results/sqlite_store.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <random>

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

std::string insert_sql(const ChainTable& table) {
    std::string sql = "INSERT INTO " + std::string(table.name) + " VALUES (?1";
    for (std::size_t k = 2; k <= table.columns.size() + 1; ++k) sql += fmt::format(", ?{}", k);
    return sql + ")";
}

// Appends rows to one chain.
class HashChain {
  public:
    static Result<HashChain> open(Database& database, const ChainTable& table, const std::string& store_id) {
        auto insert = database.prepare(insert_sql(table));
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

}  // namespace

struct SqliteStore::Parts {
    common::UniqueFd lock;
    SqliteStoreOptions options;
    std::unique_ptr<Database> database;
    std::optional<HashChain> results, commands, changes;
    bool broken = false;

    std::int64_t run = 0;
    bool adopted = false;          // the run was in the file already: it was opened again after an error
    std::uint64_t last_entry = 0;  // of this run
    std::uint32_t last_sequence = 0;
    std::array<InUse, 3> in_use{};  // by ChangeRecord::What: recipe, configuration, calibration

    Result<void> prepare();
    Result<void> load();
    Result<void> close_batch(Transaction& transaction);

    Result<void> store(std::uint64_t entry, const StartRecord& start);
    Result<void> store(std::uint64_t entry, const ChangeRecord& change);
    Result<void> store(std::uint64_t entry, const CommandRecord& command) {
        return commands->append(run, entry, command.time_us, values_of(command));
    }
    Result<void> store(std::uint64_t entry, const ResultRecord& result);
    Result<void> store(std::uint64_t entry, const AcknowledgeRecord& acknowledge);
    Result<bool> prune(const ChainTable& table, const Retention& retention, UtcMicros now_us);
};

// -- opening

Result<std::unique_ptr<SqliteStore>> SqliteStore::open(const fs::path& folder, const SqliteStoreOptions& options) {
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
    auto parts = std::make_unique<Parts>(Parts{std::move(*lock), options, std::move(*database), {}, {}, {}});
    if (auto done = parts->prepare(); !done) return tl::unexpected(done.error());
    if (auto done = parts->load(); !done) return tl::unexpected(done.error());
    return std::unique_ptr<SqliteStore>(new SqliteStore(std::move(parts)));
}

SqliteStore::SqliteStore(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
SqliteStore::~SqliteStore() = default;
std::uint32_t SqliteStore::last_sequence() const { return parts_->last_sequence; }

Result<void> SqliteStore::Parts::prepare() {
    const auto age = check_schema(*database);
    if (!age) return tl::unexpected(age.error());
    if (*age == Age::empty) {
        // auto_vacuum sets the layout of the file: it must be the first statement.
        if (auto done = database->execute("PRAGMA auto_vacuum = INCREMENTAL"); !done) return done;
    }
    // Bounds the write-ahead log: a checkpoint every 1000 pages (SQLite's default), and 16 MB after a burst.
    if (auto done = database->execute(
            "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA journal_size_limit = 16777216; "
            "PRAGMA temp_store = MEMORY");
        !done) {
        return done;
    }
    if (*age == Age::empty) {
        if (auto done = create_schema(*database, random_id()); !done) return done;
    }
    const auto id = database->get("SELECT value FROM meta WHERE key = 'id'");
    if (!id) return tl::unexpected(id.error());
    const auto* text = std::get_if<std::string>(&*id);
    // Begun even without a migration: a store that cannot be written fails here.
    auto transaction = Transaction::begin(*database);
    if (!transaction) return tl::unexpected(transaction.error());
    int from = kSchemaVersion;
    if (*age == Age::older) {
        const auto migrated = migrate_schema(*database);
        if (!migrated) return tl::unexpected(migrated.error());
        from = *migrated;
    }
    for (auto [chain, table] :
         {std::pair(&results, &kResults), std::pair(&commands, &kCommands), std::pair(&changes, &kChanges)}) {
        auto opened = HashChain::open(*database, *table, text != nullptr ? *text : "");
        if (!opened) return tl::unexpected(opened.error());
        chain->emplace(std::move(*opened));
    }
    if (from == kSchemaVersion) return {};
    const std::vector<Value> row{std::string("migration"), std::string(),        std::int64_t{0},
                                 std::string("schema"),    std::to_string(from), std::to_string(kSchemaVersion)};
    if (auto done = changes->append(0, 0, 0, row); !done) return done;
    return close_batch(*transaction);
}

// The state of the last run in the file.
Result<void> SqliteStore::Parts::load() {
    for (std::size_t k = 0; k < in_use.size(); ++k) {
        auto newest =
            database->prepare("SELECT number, after FROM changes WHERE what = ?1 ORDER BY number DESC LIMIT 1");
        if (!newest) return tl::unexpected(newest.error());
        const Value what = std::string(name_of(static_cast<ChangeRecord::What>(k)));
        if (auto bound = newest->bind(std::span(&what, 1)); !bound) return bound;
        auto row = newest->step();
        if (!row) return tl::unexpected(row.error());
        if (*row) in_use[k] = {std::get<std::int64_t>(newest->value(0)), std::get<std::string>(newest->value(1))};
    }
    return {};
}

// -- writing

Result<void> SqliteStore::do_write(std::span<const Entry> entries) {
    if (parts_->broken) return fail(ErrorCode::internal, "the store failed before", "open it again");
    parts_->broken = true;
    auto transaction = Transaction::begin(*parts_->database);
    if (!transaction) return tl::unexpected(transaction.error());
    for (const Entry& entry : entries) {
        if (entry.number != 0 && entry.number <= parts_->last_entry) continue;
        auto done = std::visit([&](const auto& record) { return parts_->store(entry.number, record); }, entry.record);
        if (!done) return done;
        if (entry.number != 0) parts_->last_entry = entry.number;
    }
    if (auto done = parts_->close_batch(*transaction); !done) return done;
    parts_->broken = false;
    return {};
}

Result<void> SqliteStore::Parts::close_batch(Transaction& transaction) {
    for (std::optional<HashChain>* chain : {&results, &commands, &changes}) {
        if (auto done = (*chain)->write_head(); !done) return done;
    }
    return transaction.commit();
}

// A run that the file already has continues: the store was opened again after an error.
Result<void> SqliteStore::Parts::store(std::uint64_t entry, const StartRecord& start) {
    auto newest = database->prepare(
        "SELECT number, time_us, after FROM changes WHERE what = 'start' ORDER BY number DESC LIMIT 1");
    if (!newest) return tl::unexpected(newest.error());
    const auto row = newest->step();
    if (!row) return tl::unexpected(row.error());
    std::string before;
    last_entry = 0;
    last_sequence = 0;
    adopted = false;
    if (*row) {
        before = std::get<std::string>(newest->value(2));
        if (std::get<std::int64_t>(newest->value(1)) == start.time_us && before == to_json_line(start)) {
            run = std::get<std::int64_t>(newest->value(0));
            for (const char* sql : {"SELECT iif(run = ?1, entry, 0) FROM results ORDER BY number DESC LIMIT 1",
                                    "SELECT iif(run = ?1, entry, 0) FROM commands ORDER BY number DESC LIMIT 1",
                                    "SELECT max(entry) FROM changes WHERE run = ?1"}) {
                const auto last = database->get_integer(sql, std::array<Value, 1>{run});
                if (!last) return tl::unexpected(last.error());
                last_entry = std::max(last_entry, static_cast<std::uint64_t>(*last));
            }
            const auto sequence =
                database->get_integer("SELECT iif(run = ?1, sequence, 0) FROM results ORDER BY number DESC LIMIT 1",
                                      std::array<Value, 1>{run});
            if (!sequence) return tl::unexpected(sequence.error());
            last_sequence = static_cast<std::uint32_t>(*sequence);
            adopted = true;
            return {};
        }
    }
    run = changes->next_number();
    return changes->append(run, entry, start.time_us, values_of(start, before));
}

Result<void> SqliteStore::Parts::store(std::uint64_t entry, const ChangeRecord& change) {
    const auto what = static_cast<std::size_t>(change.what);
    if (what >= in_use.size()) return changes->append(run, entry, change.time_us, values_of(change));
    if (entry == 0 && adopted) return {};  // the file knows better: it may have more than its writer was told
    InUse& now = in_use[what];
    if (change.if_new && now.number != 0 && now.after == change.after) return {};
    ChangeRecord written = change;
    if (change.if_new) written.before = now.after;
    now = {changes->next_number(), change.after};
    return changes->append(run, entry, change.time_us, values_of(written));
}

Result<void> SqliteStore::Parts::store(std::uint64_t entry, const ResultRecord& result) {
    last_sequence = result.result.sequence;
    const auto reference = [this](ChangeRecord::What what) {
        return in_use[static_cast<std::size_t>(what)].reference();
    };
    return results->append(
        run, entry, result.time_us,
        values_of(result, reference(ChangeRecord::What::recipe), reference(ChangeRecord::What::calibration)));
}

Result<void> SqliteStore::Parts::store(std::uint64_t /*entry*/, const AcknowledgeRecord& acknowledge) {
    auto upsert = database->prepare("INSERT OR REPLACE INTO acknowledged VALUES (?1, ?2, ?3, ?4)");
    if (!upsert) return tl::unexpected(upsert.error());
    return upsert->run(
        std::array<Value, 4>{run, std::int64_t{acknowledge.sequence}, acknowledge.time_us, acknowledge.peer});
}

// -- retention

Result<bool> SqliteStore::do_prune(const Retention& retention, UtcMicros now_us) {
    if (parts_->broken) return fail(ErrorCode::internal, "the store failed before", "open it again");
    parts_->broken = true;
    bool more = false;
    for (const ChainTable* table : {&kResults, &kCommands}) {
        const auto done = parts_->prune(*table, retention, now_us);
        if (!done) return done;
        more = more || *done;
    }
    // Returns free pages to the file system, a few at a time.
    if (auto done = parts_->database->execute("PRAGMA incremental_vacuum(4096)"); !done)
        return tl::unexpected(done.error());
    parts_->broken = false;
    return more;
}

Result<bool> SqliteStore::Parts::prune(const ChainTable& table, const Retention& retention, UtcMicros now_us) {
    const std::string name(table.name);
    std::array<std::int64_t, 5> known{};
    const std::array<std::string, 5> questions{"SELECT min(number) FROM " + name, "SELECT max(number) FROM " + name,
                                               "PRAGMA page_count", "PRAGMA freelist_count", "PRAGMA page_size"};
    for (std::size_t k = 0; k < known.size(); ++k) {
        const auto answer = database->get_integer(questions[k]);
        if (!answer) return tl::unexpected(answer.error());
        known[k] = *answer;
    }
    const auto [first, last, pages, free_pages, page_size] = known;
    if (first >= last) return false;  // the newest row stays, so that the chain can go on from it

    // By age: all rows before the first one that is young enough. A clock that was set back only keeps rows longer.
    std::int64_t remove_to = first - 1;
    bool more = false;
    const std::int64_t furthest = std::min(last - 1, first + options.rows_in_one_prune - 1);
    if (retention.keep_us > 0) {
        auto rows = database->prepare("SELECT number, time_us FROM " + name + " WHERE number <= ?1 ORDER BY number");
        if (!rows) return tl::unexpected(rows.error());
        if (auto bound = rows->bind(std::array<Value, 1>{furthest}); !bound) return tl::unexpected(bound.error());
        while (true) {
            const auto row = rows->step();
            if (!row) return row;
            if (!*row || std::get<std::int64_t>(rows->value(1)) >= now_us - retention.keep_us) break;
            remove_to = std::get<std::int64_t>(rows->value(0));
        }
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

    auto transaction = Transaction::begin(*database);
    if (!transaction) return tl::unexpected(transaction.error());
    const auto hash = database->get("SELECT hash FROM " + name + " WHERE number = ?1", std::array<Value, 1>{remove_to});
    if (!hash) return tl::unexpected(hash.error());
    const auto* bytes = std::get_if<Blob>(&*hash);
    auto remove = database->prepare("DELETE FROM " + name + " WHERE number <= ?1");
    if (!remove) return tl::unexpected(remove.error());
    if (auto done = remove->run(std::array<Value, 1>{remove_to}); !done) return tl::unexpected(done.error());
    // verify needs this row when the chain begins after row 1.
    const std::string what =
        to_text({{"from", first}, {"to", remove_to}, {"hash", bytes != nullptr ? to_hex(*bytes) : ""}});
    if (auto done = changes->append(
            run, 0, now_us, {std::string("retention"), std::string(), std::int64_t{0}, name, std::string(), what});
        !done) {
        return tl::unexpected(done.error());
    }
    if (auto done = close_batch(*transaction); !done) return tl::unexpected(done.error());
    return more;
}

}  // namespace hord::firmware::store
