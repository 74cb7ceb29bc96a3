// Reads and replaces whole files. A reader finds the old content or the new one, never a part of it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <system_error>

#include <sys/types.h>

#include "common/result.h"

namespace hord::common {

// Of texts. A calibration with a shift of up to 12 bytes for each of 700,000 lenslets (25 megapixels, 6 px) has 8 MB. A
// larger file would keep a station waiting that reads it again while it runs.
constexpr std::size_t kMaxText = std::size_t{64} << 20;

// None: it cannot be read, is a folder or a device, or has more than `most` bytes; errno says why. Waits at most 5 s
// for each piece of a pipe; reads at most 64 MiB of it.
std::optional<std::string> read_file(const std::filesystem::path& file, std::size_t most = std::size_t{2} << 30);

// The error of a read_file() that has just failed: unreadable, with errno's reason; of a silent pipe, what it is.
[[nodiscard]] Error cannot_read(const std::filesystem::path& file);

// Whether a rename to this place destroys nothing but an old file. Fails with refused if a symbolic link, a device, a
// pipe, a socket or a folder is there.
Result<void> check_replaceable(const std::filesystem::path& file);

// Makes the folder (not its parents) unless it exists. Does not throw, whatever the disk answers.
[[nodiscard]] std::error_code ensure_folder(const std::filesystem::path& folder);

// Writes FILE.XXXXXXXX.part, a name of its own, and renames it. Does not wait for the disk: a power cut may lose the
// file. Fails with not_found (the folder), refused (as check_replaceable()) or io; the unfinished file is removed then.
Result<void> write_atomically(const std::filesystem::path& file, std::span<const std::uint8_t> bytes);

// Writes FILE.XXXXXXXX.new, syncs it, renames it and syncs the folder: after a power cut the file is the old or the new
// one. Fails with not_found (the folder), refused (as check_replaceable()) and io; the last two name the file. The old
// file is unchanged and the new one removed then, unless only the folder's sync failed.
Result<void> write_durably(const std::filesystem::path& file, std::string_view text);

// Steps of the above. Each returns 0 or errno. replace_file() writes FILE, 8 random digits and the suffix,
// syncs it if asked, and renames it; after a failure it is removed. A file that is replaced keeps its owner, group and
// mode, as far as this user may give them; `mode` is that of a new file.
[[nodiscard]] int replace_file(const std::filesystem::path& file, const char* suffix, mode_t mode, bool sync,
                               std::span<const std::byte> bytes);
[[nodiscard]] int write_all(int fd, std::span<const std::byte> bytes);
[[nodiscard]] int sync_folder_of(const std::filesystem::path& file);

}  // namespace hord::common
