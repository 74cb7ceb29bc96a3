// Files of a store that cannot be used: this user may not write them, as a station that was run there as root leaves
// them, or they are no regular files.
#pragma once

#include <filesystem>
#include <string>

#include "common/result.h"

namespace hord::firmware::store {

constexpr const char* kLockFile = "lock";  // one writer a store

// What to give the station's user: the folder alone is not enough.
std::string rights_cure(const std::filesystem::path& folder);

// Whether the database and the files of SQLite beside it are regular files, as far as they are there: opening a pipe
// waits for ever. Fails with refused: names the first that is none. Opens nothing.
Result<void> check_database_files(const std::filesystem::path& database);
// The same of the whole store, with its lock. Fails also with not_found: results.db is a link to a folder that is
// missing.
Result<void> check_files(const std::filesystem::path& folder);

// Whether this user may write the store's files that are there. Fails with io: names all that he may not.
Result<void> check_rights(const std::filesystem::path& folder);

}  // namespace hord::firmware::store
