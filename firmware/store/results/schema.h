// The tables of a store, their versions, and how an older file becomes a newer one.
//
// results and commands grow fast and lose their oldest rows to retention; changes stay. Each of the three is a hash
// chain of its own: `number` counts from 1 without gaps for the life of the store, over restarts. `v` is the schema
// version that the row was written with; its hash covers the columns of that version, so that a migration never touches
// a row that exists.
//
//   results   one row a part                            recipe, calibration: the row of changes that was in use
//   commands  one row a command of a PLC or a person
//   changes   what = start (its number is the `run` of what follows), recipe, configuration, calibration, lost,
//   retention, migration heads     the newest number and hash of each chain, written with the row acknowledged  how far
//   a PLC has taken the results of a run
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "firmware/store/results/database.h"
#include "firmware/store/results/hash_chain.h"

namespace hord::firmware::store {

constexpr int kSchemaVersion = 2;

struct ChainTable {
    std::string_view name;
    std::span<const std::string_view> columns;                      // all but `hash`, which is the last of the table
    std::span<const int> columns_of_version;                        // how many of them version 1, 2 ... had
    [[nodiscard]] std::string select(std::string_view rest) const;  // "SELECT columns, hash FROM name " + rest
};
extern const ChainTable kResults, kCommands, kChanges;
std::span<const ChainTable* const> chain_tables();

// Places of columns that all three have.
constexpr std::size_t kNumberColumn = 0, kVersionColumn = 1, kRunColumn = 2, kEntryColumn = 3, kTimeColumn = 4;

enum class Age : std::uint8_t { empty, older, current };

// Which schema the file has. Fails with unsupported (written by newer software), unreadable (not a store).
Result<Age> check_schema(Database& database);

// Makes the tables of an empty file, in a transaction of its own. `id` is the store's name for itself, random.
Result<void> create_schema(Database& database, const std::string& id);

// Brings an older file to this version inside the caller's transaction; gives the version that it had.
Result<int> migrate_schema(Database& database);

}  // namespace hord::firmware::store
