// A pipe, a socket, a device or a folder in the place of a regular file. Opening a pipe may wait for ever.
#pragma once

#include <filesystem>
#include <string>

#include "common/result.h"

namespace hord::common {

// "a pipe", "a socket", "a device", "a folder"; nullptr: a regular file, a symbolic link, nothing, or not known.
const char* name_of_irregular(std::filesystem::file_type type);

// Fails with refused: "FILE is a pipe, not a regular file", and the cure. Follows links. A file that is missing, or
// that cannot be looked at, is left to who opens it.
[[nodiscard]] Result<void> check_regular(const std::filesystem::path& file, const std::string& cure);

}  // namespace hord::common
