// A small file that is either the old one or the new one, whatever happens in between.
#pragma once

#include <filesystem>
#include <string_view>

#include "common/result.h"

namespace hord::common {

// Writes beside it, syncs, renames, syncs the folder. Fails with io (names the file); the old file is whole then, and
// nothing lies beside it.
Result<void> write_durably(const std::filesystem::path& file, std::string_view text);

}  // namespace hord::common
