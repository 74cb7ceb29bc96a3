// The tables of a store, their versions, and the migration of older files.
//
//   results       one row a part; columns recipe and calibration: numbers of the rows of `changes` in use
//   commands      one row a command of a PLC or a person
//   changes       what = start (its number is the `run` of the rows that follow), recipe, configuration, calibration,
//                 lost, clock (a day that the clock has shown, clock_days.h), retention, migration
//   heads         the newest number and hash of each hash chain, written in the row's transaction
//   acknowledged  the newest result of each run that a PLC has acknowledged
//
// results, commands and changes are three hash chains. `number` counts from 1 without gaps, over restarts. `v` is the
// schema version of the row. A row's hash covers the columns that its version had; later ones are NULL in it. Version 3
// added results.bounded.
// Retention removes the oldest results and commands; changes are never removed.
//
// Tables of new files are STRICT. Those of older files are not, and stay so: they would have to be written anew.
// Readers check the type of every value in both.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "firmware/store/results/database.h"
#include "firmware/store/results/hash_chain.h"

namespace hord::firmware::store {

constexpr int kSchemaVersion = 3;

struct ChainTable {
    std::string_view name;
    std::span<const std::string_view> columns;  // all but `hash`, in the order of the hash
    std::size_t columns_before_3;               // of these, in versions 1 and 2
};
extern const ChainTable kResults, kCommands, kChanges;

// Column indices that the three tables share.
constexpr int kNumberColumn = 0, kVersionColumn = 1, kRunColumn = 2;

enum class Age : std::uint8_t { empty, older, current };

// The file's schema against kSchemaVersion. Fails with unsupported (written by newer software), unreadable (not a
// store).
Result<Age> check_schema(Database& database);

Result<std::string> read_store_id(Database& database);

// Creates the tables of an empty file in one transaction. `id`: the store's random id.
Result<void> create_schema(Database& database, const std::string& id);

// Migrates an older file inside the caller's transaction. Returns its previous version.
Result<int> migrate_schema(Database& database);

}  // namespace hord::firmware::store
