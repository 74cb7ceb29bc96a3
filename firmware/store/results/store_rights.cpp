#include "firmware/store/results/store_rights.h"

#include <cerrno>
#include <cstring>

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include "common/dangling_link.h"
#include "common/regular_file.h"
#include "firmware/store/results/sqlite_store.h"

namespace hord::firmware::store {
namespace {

constexpr const char* kMoveAway = "move it out of the folder: the station makes a new one";

}  // namespace

std::string rights_cure(const std::filesystem::path& folder) {
    return fmt::format(
        "give the station's user {} with {}, {}, its -wal and -shm and the frames (chown -R), and see that its disk is "
        "not "
        "mounted read-only",
        folder.string(), kLockFile, kStoreFile);
}

Result<void> check_database_files(const std::filesystem::path& database) {
    for (const char* const suffix : {"", "-wal", "-shm", "-journal"}) {
        if (auto fine = common::check_regular(database.string() + suffix, kMoveAway); !fine) return fine;
    }
    return {};
}

Result<void> check_files(const std::filesystem::path& folder) {
    const std::filesystem::path database = folder / kStoreFile;
    if (auto fine = common::check_regular(folder / kLockFile, kMoveAway); !fine) return fine;
    if (auto fine = check_database_files(database); !fine) return fine;
    // SQLite makes the file that a link leads to, but not its folder.
    std::error_code none;
    const std::filesystem::path target = folder / std::filesystem::read_symlink(database, none);
    if (none || std::filesystem::is_directory(target.parent_path(), none)) return {};
    return fail(
        ErrorCode::not_found, common::dangling_link(database),
        "make the folder that it leads to or mount its disk, or remove the link: the station begins a new store");
}

Result<void> check_rights(const std::filesystem::path& folder) {
    std::string refused;
    int why = 0;
    const std::string file = kStoreFile;
    for (const std::string& name : {std::string(kLockFile), file, file + "-wal", file + "-shm"}) {
        const std::filesystem::path path = folder / name;
        if (::faccessat(AT_FDCWD, path.c_str(), W_OK, AT_EACCESS) == 0 || errno == ENOENT) continue;
        why = errno;
        refused += (refused.empty() ? "" : ", ") + path.string();
    }
    if (refused.empty()) return {};
    return fail(ErrorCode::io, fmt::format("{} cannot be written ({})", refused, std::strerror(why)),
                rights_cure(folder));
}

}  // namespace hord::firmware::store
