// Files that are replaced as a whole: a reader finds the old content or the new one, never a part of it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string_view>

#include "common/result.h"

namespace hord::common {

// Writes FILE.part and renames it. Does not wait for the disk: a power cut may lose the file. Fails with not_found (the
// folder) or io; FILE.part is removed then.
Result<void> write_atomically(const std::filesystem::path& file, std::span<const std::uint8_t> bytes);

// Writes FILE.new, syncs it, renames it and syncs the folder: after a power cut the file is the old or the new one.
// Fails with io (names the file); the old file is unchanged and FILE.new is removed, unless only the folder's sync
// failed.
Result<void> write_durably(const std::filesystem::path& file, std::string_view text);

// Steps of the above. Each returns 0 or errno.
[[nodiscard]] int write_all(int fd, std::span<const std::byte> bytes);
[[nodiscard]] int sync_folder_of(const std::filesystem::path& file);

}  // namespace hord::common
