#include "firmware/store/results/store_rights.h"

#include <cerrno>
#include <cstring>

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include "firmware/store/results/sqlite_store.h"

namespace hord::firmware::store {

std::string rights_cure(const std::filesystem::path& folder) {
    return fmt::format(
        "give the station's user {} with {}, {}, its -wal and -shm and the frames (chown -R), and see that its disk is "
        "not "
        "mounted read-only",
        folder.string(), kLockFile, kStoreFile);
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
