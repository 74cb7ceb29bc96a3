#include "firmware/store/results/schema.h"

#include <array>

namespace hord::firmware::store {
namespace {

constexpr std::int64_t kApplicationId = 0x484F5244;  // "HORD": file(1) and check_schema() recognise a store by it

constexpr std::array<std::string_view, 18> kResultColumns{
    "number",  "v",      "run",         "entry",        "time_us", "sequence",   "part",
    "verdict", "reason", "score",       "defect_count", "defects", "latency_us", "reject_latency_us",
    "reject",  "recipe", "calibration", "bounded"};
constexpr std::array<std::string_view, 10> kCommandColumns{"number", "v",     "run",  "entry",  "time_us",
                                                           "peer",   "token", "name", "before", "after"};
constexpr std::array<std::string_view, 11> kChangeColumns{"number", "v",     "run",  "entry",  "time_us", "what",
                                                          "peer",   "token", "name", "before", "after"};

// Version 1. STRICT refuses values of another type; files of before have the same columns and rows without it.
constexpr const char* kVersion1 = R"(
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT, WITHOUT ROWID;
CREATE TABLE results (
  number INTEGER PRIMARY KEY, v INTEGER NOT NULL, run INTEGER NOT NULL, entry INTEGER NOT NULL, )"
                                  R"(time_us INTEGER NOT NULL,
  sequence INTEGER NOT NULL, part INTEGER NOT NULL, verdict TEXT NOT NULL, reason TEXT NOT NULL, score REAL,
  defect_count INTEGER NOT NULL, defects TEXT NOT NULL, latency_us INTEGER NOT NULL, reject_latency_us INTEGER NOT NULL,
  reject TEXT NOT NULL, recipe INTEGER, calibration INTEGER, hash BLOB NOT NULL) STRICT;
CREATE INDEX results_by_time ON results (time_us);
CREATE TABLE commands (
  number INTEGER PRIMARY KEY, v INTEGER NOT NULL, run INTEGER NOT NULL, entry INTEGER NOT NULL, )"
                                  R"(time_us INTEGER NOT NULL,
  peer TEXT NOT NULL, token INTEGER NOT NULL, name TEXT NOT NULL, before TEXT NOT NULL, )"
                                  R"(after TEXT NOT NULL, hash BLOB NOT NULL) STRICT;
CREATE TABLE changes (
  number INTEGER PRIMARY KEY, v INTEGER NOT NULL, run INTEGER NOT NULL, entry INTEGER NOT NULL, )"
                                  R"(time_us INTEGER NOT NULL,
  what TEXT NOT NULL, peer TEXT NOT NULL, token INTEGER NOT NULL, name TEXT NOT NULL, before TEXT NOT NULL,
  after TEXT NOT NULL, hash BLOB NOT NULL) STRICT;
CREATE INDEX changes_by_what ON changes (what, number);
CREATE TABLE heads (chain TEXT PRIMARY KEY, number INTEGER NOT NULL, hash BLOB NOT NULL) STRICT, WITHOUT ROWID;
CREATE TABLE acknowledged (run INTEGER PRIMARY KEY, sequence INTEGER NOT NULL, time_us INTEGER NOT NULL, )"
                                  R"(peer TEXT NOT NULL) STRICT;
)";

// Version 2: parts that did not pass are found without reading those that did.
constexpr const char* kVersion2 =
    "CREATE INDEX results_not_passed ON results (verdict, number) WHERE verdict <> 'pass'";

// Version 3: 1: the score and the defects may be upper bounds; NULL: not known, of rows of before.
constexpr const char* kVersion3 = "ALTER TABLE results ADD COLUMN bounded INTEGER";

}  // namespace

const ChainTable kResults{"results", kResultColumns, kResultColumns.size() - 1};
const ChainTable kCommands{"commands", kCommandColumns, kCommandColumns.size()};
const ChainTable kChanges{"changes", kChangeColumns, kChangeColumns.size()};

Result<std::string> read_store_id(Database& database) {
    return database.get_text("SELECT value FROM meta WHERE key = 'id'");
}

Result<Age> check_schema(Database& database) {
    const auto version = database.get_integer("PRAGMA user_version");
    if (!version) return tl::unexpected(version.error());
    const auto tables = database.get_integer("SELECT count(*) FROM sqlite_schema");
    if (!tables) return tl::unexpected(tables.error());
    if (*version == 0 && *tables == 0) return Age::empty;
    const auto application = database.get_integer("PRAGMA application_id");
    if (!application) return tl::unexpected(application.error());
    if (*application != kApplicationId || *version < 1) {
        return fail(ErrorCode::unreadable, database.file().string() + " is a database, but no station's store",
                    "name the folder of a station's store");
    }
    if (*version > kSchemaVersion) {
        return fail(ErrorCode::unsupported,
                    database.file().string() + " has schema version " + std::to_string(*version) +
                        ", this software knows up to " + std::to_string(kSchemaVersion),
                    "use the newer software again, or move the store away");
    }
    return *version < kSchemaVersion ? Age::older : Age::current;
}

Result<void> create_schema(Database& database, const std::string& id) {
    auto transaction = Transaction::begin(database);
    if (!transaction) return tl::unexpected(transaction.error());
    if (auto done = database.execute(kVersion1); !done) return done;
    if (auto done = database.run("INSERT INTO meta VALUES ('id', ?1)", std::array<Value, 1>{id}); !done) return done;
    if (auto done = database.execute("PRAGMA application_id = " + std::to_string(kApplicationId)); !done) return done;
    if (auto done = database.execute("PRAGMA user_version = 1"); !done) return done;
    if (auto migrated = migrate_schema(database); !migrated) return tl::unexpected(migrated.error());
    return transaction->commit();
}

Result<int> migrate_schema(Database& database) {
    const auto version = database.get_integer("PRAGMA user_version");
    if (!version) return tl::unexpected(version.error());
    if (*version < 2) {
        if (auto done = database.execute(kVersion2); !done) return tl::unexpected(done.error());
    }
    if (*version < 3) {
        if (auto done = database.execute(kVersion3); !done) return tl::unexpected(done.error());
    }
    if (auto done = database.execute("PRAGMA user_version = " + std::to_string(kSchemaVersion)); !done)
        return tl::unexpected(done.error());
    return static_cast<int>(*version);
}

}  // namespace hord::firmware::store
