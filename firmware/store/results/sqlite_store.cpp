#include "firmware/store/results/sqlite_store.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <optional>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/dangling_link.h"
#include "common/unique_fd.h"
#include "firmware/store/results/chain_writer.h"
#include "firmware/store/results/clock_days.h"
#include "firmware/store/results/database.h"
#include "firmware/store/results/export.h"
#include "firmware/store/results/hash_chain.h"
#include "firmware/store/results/records.h"
#include "firmware/store/results/schema.h"
#include "firmware/store/results/store_rights.h"

namespace hord::firmware::store {
namespace {

namespace fs = std::filesystem;

void report_full(const SqliteStoreOptions& options, bool full) {
    if (full && options.disk_full) options.disk_full();
}

tl::unexpected<Error> written_by_another(const fs::path& folder) {
    return fail(ErrorCode::busy, folder.string() + " is written by another program",
                "give each station a store.folder of its own");
}

// One writer a store: a lock of the process (flock), which ends with it even when it is killed.
Result<common::UniqueFd> lock_folder(const fs::path& folder, const SqliteStoreOptions& options) {
    const fs::path file = folder / kLockFile;
    common::UniqueFd fd(open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
    if (!fd) {
        const int why = errno;
        report_full(options, why == ENOSPC || why == EDQUOT);
        return fail(ErrorCode::io, file.string() + " cannot be written (" + std::strerror(why) + ")",
                    why == ENOSPC || why == EDQUOT ? "free space on its disk" : rights_cure(folder));
    }
    if (flock(fd.get(), LOCK_EX | LOCK_NB) != 0) return written_by_another(folder);
    return fd;
}

// The change in use of one kind; the following results refer to it.
struct InUse {
    std::int64_t number = 0;  // 0: none
    std::string after = {};
    [[nodiscard]] Value reference() const { return number == 0 ? Value{} : Value(number); }
};

// A store that goes on with open files that have no name would promise what nobody can read.
Error moved_away(const fs::path& file) {
    return {ErrorCode::not_found,
            file.string() + " was moved, removed or replaced while the station used it; results wait in memory",
            "put it back with its -wal and its -shm, or move those out of the folder, too, and restart the station: it "
            "begins a new one"};
}

Error log_moved_away(const std::string& name) {
    return {ErrorCode::io, name + " was moved, removed or replaced while the station used it",
            "leave the files beside " + std::string(kStoreFile) + " alone; the station opens its store again"};
}

Error log_without_database(const fs::path& file) {
    return {ErrorCode::not_found, file.string() + "-wal is there, but its " + kStoreFile + " is not",
            "put " + std::string(kStoreFile) + " back, or move its -wal and its -shm out of the folder, too"};
}

Error log_of_empty(const fs::path& file) {
    return {ErrorCode::unreadable, file.string() + " is empty, 0 bytes, and its -wal has results",
            "stop the station, keep the -wal, and put a backup of " + std::string(kStoreFile) +
                " in its place; or move the three files out of the folder: the station begins a new store"};
}

// The file that a path leads to; both 0: none.
struct FileId {
    dev_t device = 0;
    ino_t inode = 0;
    bool operator==(const FileId&) const = default;
};
FileId file_id(const std::string& path) {
    struct stat found {};
    return ::stat(path.c_str(), &found) == 0 ? FileId{found.st_dev, found.st_ino} : FileId{};
}

class SqliteStore final : public ResultStore {
  public:
    SqliteStore(common::UniqueFd lock, const SqliteStoreOptions& options, std::unique_ptr<Database> database)
        : lock_(std::move(lock)), options_(options), database_(std::move(database)) {}
    // Migrates the file and reads the changes in use.
    Result<void> prepare();

    [[nodiscard]] bool disk_full() const { return database_->disk_full(); }

    Result<void> write(std::span<const Entry> entries) override;
    Result<bool> prune(const Retention& retention, const ClockReading& now) override;

  private:
    Result<void> write_batch(std::span<const Entry> entries);
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
    [[nodiscard]] std::array<FileId, 3> files() const;
    Result<void> check_files();
    Result<void> read_changes();
    Result<void> witness(const ClockReading& now);
    Result<bool> witness_and_prune(const Retention& retention, const ClockReading& now);
    Result<bool> prune(const ChainTable& table, const Retention& retention, UtcMicros now_us);
    Result<void> remove(const ChainTable& table, std::int64_t first, std::int64_t to, const Json& why,
                        UtcMicros now_us);
    InUse& in_use(ChangeRecord::What what) { return in_use_[static_cast<std::size_t>(what)]; }

    common::UniqueFd lock_;
    const SqliteStoreOptions options_;
    const std::unique_ptr<Database> database_;
    std::array<FileId, 3> files_;  // those that are open; SQLite replaces none of them before it closes them
    std::optional<ChainWriter> results_, commands_, changes_;
    ClockWitness witness_;
    ClockDays days_;
    bool broken_ = false;

    std::int64_t run_ = 0;
    bool adopted_ = false;           // the run was in the file already: it was opened again after an error
    bool in_doubt_ = false;          // last_entry_ is the file's, and was not compared with what was written
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
    // Bounds the write-ahead log: a checkpoint every 250 pages, and 16 MB after a burst. A log that has filled the disk
    // cannot be moved to the database any more: 250 pages are what frames leave it (FrameRetention::kRoomForResults).
    if (auto done =
            database_->execute("PRAGMA journal_mode = WAL; PRAGMA wal_autocheckpoint = 250; PRAGMA synchronous = FULL; "
                               "PRAGMA journal_size_limit = 16777216; "
                               "PRAGMA temp_store = MEMORY");
        !done) {
        return done;
    }
    if (*age == Age::empty) {
        const auto random = database_->get_text("SELECT lower(hex(randomblob(16)))");
        if (!random) return tl::unexpected(random.error());
        if (auto done = create_schema(*database_, *random); !done) return done;
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
        auto opened = ChainWriter::open(*database_, *table, *id);
        if (!opened) return tl::unexpected(opened.error());
        chain->emplace(std::move(*opened));
    }
    files_ = files();
    if (auto done = read_changes(); !done) return done;
    if (from == kSchemaVersion) return {};
    const std::vector<Value> row{std::string("migration"), std::string(),        std::int64_t{0},
                                 std::string("schema"),    std::to_string(from), std::to_string(kSchemaVersion)};
    if (auto done = changes_->append(0, 0, 0, row); !done) return done;
    return close_batch(*transaction);
}

// The changes in use, and the days that the clock has shown.
Result<void> SqliteStore::read_changes() {
    for (std::size_t k = 0; k < in_use_.size(); ++k) {
        const std::array<Value, 1> what{std::string(name_of(static_cast<ChangeRecord::What>(k)))};
        const auto take = [&](const Statement& row) -> Result<void> {
            RowReader read(row);
            in_use_[k] = {read.integer(0), read.text(1)};
            if (read.error()) return tl::unexpected(*read.error());
            return {};
        };
        const auto done = database_->run(
            "SELECT number, after FROM changes WHERE what = ?1 ORDER BY number DESC LIMIT 1", what, take);
        if (!done) return done;
    }
    // A damaged day does not count. Nothing is removed too early without it.
    return database_->run("SELECT after FROM changes WHERE what = 'clock' ORDER BY number", {},
                          [&](const Statement& row) -> Result<void> {
                              const auto text = row.text(0);
                              const auto day = text ? clock_day_from(*text) : std::nullopt;
                              if (day) days_.add(*day);
                              return {};
                          });
}

// -- writing

Result<void> SqliteStore::write(std::span<const Entry> entries) {
    if (broken_) return fail(ErrorCode::internal, "the store failed before", "open it again");
    broken_ = true;
    auto done = entries.empty() ? Result<void>() : write_batch(entries);
    if (done) done = check_files();  // after the commit: a batch in files that have no name is not durable
    broken_ = !done;
    report_full(options_, broken_ && database_->disk_full());
    return done;
}

Result<void> SqliteStore::write_batch(std::span<const Entry> entries) {
    auto transaction = Transaction::begin(*database_);
    if (!transaction) return tl::unexpected(transaction.error());
    const std::uint64_t newest = entries.back().number;  // they count upwards
    for (const Entry& entry : entries) {
        // A batch that an error left in doubt is the first one after it. A higher entry in the file would make the
        // store skip results that it does not have.
        if (entry.number != 0 && std::exchange(in_doubt_, false) && last_entry_ > newest)
            return database_->damaged(
                fmt::format("it has entry {} of this run, and {} is the newest", last_entry_, newest));
        if (entry.number != 0 && entry.number <= last_entry_) continue;
        auto done = std::visit([&](const auto& record) { return store(entry.number, record); }, entry.record);
        if (!done) return done;
        if (entry.number != 0) last_entry_ = entry.number;
    }
    return close_batch(*transaction);
}

// The database, its log and the log's index.
std::array<FileId, 3> SqliteStore::files() const {
    const std::string name = database_->file().string();
    return {file_id(name), file_id(name + "-wal"), file_id(name + "-shm")};
}

Result<void> SqliteStore::check_files() {
    const auto now = files();
    if (now == files_) return {};
    const std::string name = database_->file().string();
    // Closing moves what is in the open log to the database, wherever the log's name leads to.
    if (now[0] == files_[0]) return tl::unexpected(log_moved_away(name + (now[1] == files_[1] ? "-shm" : "-wal")));
    *options_.moved = true;
    return tl::unexpected(moved_away(database_->file()));
}

Result<void> SqliteStore::close_batch(Transaction& transaction) {
    for (std::optional<ChainWriter>* chain : {&results_, &commands_, &changes_}) {
        if (auto done = (*chain)->write_head(); !done) return done;
    }
    return transaction.commit();
}

// A run that the file already has continues: the store was opened again after an error.
Result<void> SqliteStore::store(std::uint64_t entry, const StartRecord& start) {
    std::string before;
    last_entry_ = 0;
    adopted_ = in_doubt_ = false;
    const auto take = [&](const Statement& row) -> Result<void> {
        RowReader read(row);
        run_ = read.integer(0);
        before = read.text(2);
        adopted_ = read.integer(1) == start.time_us && before == to_json_line(start);
        if (read.error()) return tl::unexpected(*read.error());
        return {};
    };
    const auto read = database_->run(
        "SELECT number, time_us, after FROM changes WHERE what = 'start' ORDER BY number DESC LIMIT 1", {}, take);
    if (!read) return read;
    if (!adopted_) {
        run_ = changes_->next_number();
        return changes_->append(run_, entry, start.time_us, values_of(start, before));
    }
    in_doubt_ = true;
    for (const char* sql : {"SELECT iif(run = ?1, entry, 0) FROM results ORDER BY number DESC LIMIT 1",
                            "SELECT iif(run = ?1, entry, 0) FROM commands ORDER BY number DESC LIMIT 1",
                            "SELECT max(entry) FROM changes WHERE run = ?1"}) {
        const auto last = database_->get_integer(sql, std::array<Value, 1>{run_});
        if (!last) return tl::unexpected(last.error());
        if (*last < 0) return database_->damaged("an entry has a negative number");
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

Result<bool> SqliteStore::prune(const Retention& retention, const ClockReading& now) {
    if (broken_) return fail(ErrorCode::internal, "the store failed before", "open it again");
    auto more = witness_and_prune(retention, now);
    broken_ = !more;
    report_full(options_, broken_ && database_->disk_full());
    return more;
}

Result<bool> SqliteStore::witness_and_prune(const Retention& retention, const ClockReading& now) {
    if (auto done = witness(now); !done) return tl::unexpected(done.error());
    bool more = false;
    for (const ChainTable* table : {&kResults, &kCommands}) {
        const auto done = prune(*table, retention, now.utc_us);
        if (!done) return done;
        more = more || *done;
    }
    // Returns free pages to the file system, a few at a time.
    if (auto done = database_->execute("PRAGMA incremental_vacuum(4096)"); !done) return tl::unexpected(done.error());
    return more;
}

// Enters the day once the clock has shown it for long enough.
Result<void> SqliteStore::witness(const ClockReading& now) {
    const auto shown = witness_.observe(now);
    if (!shown || shown == days_.newest()) return {};
    const ClockDay day{*shown, results_->number(), commands_->number()};
    auto transaction = Transaction::begin(*database_);
    if (!transaction) return tl::unexpected(transaction.error());
    const std::vector<Value> row{std::string("clock"), std::string(), std::int64_t{0},
                                 std::string("day"),   std::string(), to_json_line(day)};
    if (auto done = changes_->append(run_, 0, now.utc_us, row); !done) return done;
    if (auto done = close_batch(*transaction); !done) return done;
    days_.add(day);
    witness_.entered();
    return {};
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
    const auto [lowest, last, pages, free_pages, page_size] = known;
    const std::int64_t first = std::max<std::int64_t>(lowest, 1);
    if (first >= last) return false;  // the newest row stays, so that the chain can go on from it

    std::int64_t remove_to = first - 1, wanted = 0;
    const std::int64_t furthest = std::min(last - 1, first + options_.rows_in_one_prune - 1);
    Json why;
    // By age, by the days that the clock has shown (clock_days.h).
    if (const auto older = retention.keep_days > 0 ? days_.older_than(retention.keep_days) : std::nullopt) {
        wanted = std::min(last - 1, &table == &kResults ? older->entry.results : older->entry.commands);
        remove_to = std::min(furthest, wanted);
        why = {{"rule", "keep_days"},
               {"limit", retention.keep_days},
               {"age_days", older->age_days},
               {"witnessed", format_day(older->entry.day)}};
    }
    // By size: the share of the rows above the limit, and 1 % more, so that not every call has to remove rows.
    const auto used = static_cast<double>((pages - free_pages) * page_size);
    if (retention.max_bytes > 0 && used > static_cast<double>(retention.max_bytes)) {
        const double share = std::min(1.0, (used - static_cast<double>(retention.max_bytes)) / used + 0.01);
        const auto by_size =
            std::min(last - 1, first + static_cast<std::int64_t>(share * static_cast<double>(last - first + 1)));
        if (by_size > remove_to) {
            why = {{"rule", "keep_mb"}, {"limit_bytes", retention.max_bytes}, {"used_bytes", std::llround(used)}};
        }
        wanted = std::max(wanted, by_size);
        remove_to = std::max(remove_to, std::min(furthest, by_size));
    }
    if (remove_to < first) return false;
    if (auto done = remove(table, first, remove_to, why, now_us); !done) return tl::unexpected(done.error());
    return wanted > remove_to;
}

// Removes the rows up to `to`, and enters which and why in the changes.
Result<void> SqliteStore::remove(const ChainTable& table, std::int64_t first, std::int64_t to, const Json& why,
                                 UtcMicros now_us) {
    const std::string name(table.name);
    auto transaction = Transaction::begin(*database_);
    if (!transaction) return tl::unexpected(transaction.error());
    Json what{{"from", first}, {"to", to}};
    // A damaged time or hash does not keep its row; null and "" say that it could not be read.
    for (const auto& [key, number] : {std::pair("first_time", first), std::pair("last_time", to)}) {
        const auto time =
            database_->get_integer("SELECT time_us FROM " + name + " WHERE number = ?1", std::array<Value, 1>{number});
        if (!time && time.error().code != ErrorCode::unreadable) return tl::unexpected(time.error());
        what[key] = time ? Json(format_utc(*time)) : Json();
    }
    const std::array<Value, 1> up_to{to};
    const auto hash = database_->get("SELECT hash FROM " + name + " WHERE number = ?1", up_to);
    if (!hash) return tl::unexpected(hash.error());
    const auto* bytes = std::get_if<Blob>(&*hash);
    what["hash"] = bytes != nullptr ? to_hex(*bytes) : "";  // verify needs it when the chain begins after row 1
    what.update(why);
    const std::vector<Value> row{
        std::string("retention"), std::string(), std::int64_t{0}, name, std::string(), to_text(what)};
    return database_->run("DELETE FROM " + name + " WHERE number <= ?1", up_to)
        .and_then([&] { return changes_->append(run_, 0, now_us, row); })
        .and_then([&] { return close_batch(*transaction); });
}

}  // namespace

tl::unexpected<Error> folder_unusable(const fs::path& folder, std::error_code why) {
    const std::string link = common::dangling_link(folder);
    const bool file = why == std::errc::file_exists || why == std::errc::not_a_directory;
    std::error_code none;
    const fs::path above = fs::absolute(folder, none).lexically_normal().parent_path();
    const bool lacks_above = why == std::errc::no_such_file_or_directory && !fs::exists(above, none);
    return fail(ErrorCode::io,
                "the folder " + folder.string() + " cannot be made or used (" +
                    (!link.empty()     ? link
                         : lacks_above ? above.string() + " does not exist"
                                       : why.message()) +
                    ")",
                !link.empty() ? "make the folder that it leads to, or name another one (store.folder)"
                    : file
                    ? "it, or one above it, is a file: name another folder, or move that file away (store.folder)"
                    : why == std::errc::read_only_file_system
                    ? "mount its disk for writing, or name another folder (store.folder)"
                    : "create it and give it to the station's user (store.folder)");
}

Result<void> check_not_written(const fs::path& folder) {
    const common::UniqueFd fd(open((folder / kLockFile).c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    if (fd && flock(fd.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) return written_by_another(folder);
    return {};
}

Result<std::unique_ptr<ResultStore>> open_sqlite_store(const fs::path& folder, const SqliteStoreOptions& options) {
    const fs::path file = folder / kStoreFile;
    if (file_id(file.string()) == FileId{}) {
        if (*options.moved) return tl::unexpected(moved_away(file));
        // SQLite would remove this log, with the results in it, and make a new file.
        if (file_id(file.string() + "-wal") != FileId{}) return tl::unexpected(log_without_database(file));
    }
    std::error_code none;
    const bool emptied = fs::is_regular_file(file, none) && fs::file_size(file, none) == 0 && !none;
    // SQLite would remove the log of an empty file, with the results in it.
    if (emptied && fs::file_size(file.string() + "-wal", none) > 0 && !none) return tl::unexpected(log_of_empty(file));
    if (const std::error_code error = options.make_folder(folder)) {
        return folder_unusable(folder, error);
    }
    if (auto fine = check_files(folder); !fine) return tl::unexpected(fine.error());
    auto lock = lock_folder(folder, options);
    if (!lock) return tl::unexpected(lock.error());
    auto database = Database::open(file, Database::Access::create, options.vfs);
    if (!database) return tl::unexpected(database.error());
    auto store = std::make_unique<SqliteStore>(std::move(*lock), options, std::move(*database));
    if (auto done = store->prepare(); !done) {
        report_full(options, store->disk_full());
        return tl::unexpected(done.error());
    }
    *options.moved = false;
    if (emptied && options.note) {
        options.note({ErrorCode::unreadable, file.string() + " was empty, 0 bytes: a new store begins in it",
                      "if it had results before, see the disk; they are in the last backup"});
    }
    return std::unique_ptr<ResultStore>(std::move(store));
}

}  // namespace hord::firmware::store
