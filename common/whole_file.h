// A file that appears whole or not at all. Unlike write_durably() it does not wait for the disk: for what can be made
// again.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>

#include "common/result.h"

namespace hord::common {

// Writes FILE.part and renames it. Fails with not_found (the folder), io; then nothing is left beside it.
Result<void> write_whole(const std::filesystem::path& file, std::span<const std::uint8_t> bytes);

}  // namespace hord::common
