// Files of a store that its user may not write, as a station that was run there as root leaves them.
#pragma once

#include <filesystem>
#include <string>

#include "common/result.h"

namespace hord::firmware::store {

constexpr const char* kLockFile = "lock";  // one writer a store

// What to give the station's user: the folder alone is not enough.
std::string rights_cure(const std::filesystem::path& folder);

// Whether this user may write the store's files that are there. Fails with io: names all that he may not.
Result<void> check_rights(const std::filesystem::path& folder);

}  // namespace hord::firmware::store
