// Lock of a folder of state or results: one station at a time writes there.
//
// The kernel holds the lock (flock) on the folder itself, which nobody removes by mistake, and ends it with the
// process, also when that is killed. The file `station.lock` is locked, too: it tells who holds the folder, and locks
// where a file system locks no folders (NFS). The file stays. It is empty: the kernel knows the process that holds it.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "common/result.h"
#include "common/unique_fd.h"

namespace hord::firmware {

class StateLock {
  public:
    // Fails with busy if another station holds either lock, and as check_file(). Nothing is held, without an error, of
    // a folder that cannot be opened (missing): its files tell that, and the station goes on. `what` is the error's
    // name of the folder.
    [[nodiscard]] static Result<StateLock> take(const std::filesystem::path& folder,
                                                const std::string& what = "state folder");

    // "state folder /data is in use by process 4711 (hordd)"; none: no other process holds it, or its `station.lock`
    // was removed. Locks nothing: a station that starts meanwhile is not refused.
    [[nodiscard]] static std::optional<std::string> in_use(const std::filesystem::path& folder,
                                                           const std::string& what = "state folder");

    // Fails with refused if `station.lock` there is a pipe, a socket or a device: its lock would not be told.
    [[nodiscard]] static Result<void> check_file(const std::filesystem::path& folder);

    [[nodiscard]] bool held() const { return folder_ || file_; }

    // Before each write: whether the folder at the path is still the one that is held. Fails with refused if it was
    // renamed or removed; another station may hold what is at the path since. Compares nothing of a folder that could
    // not be opened. Any thread.
    [[nodiscard]] Result<void> check_place() const;

  private:
    std::filesystem::path path_;
    std::string what_;
    common::UniqueFd folder_, file_;
};

}  // namespace hord::firmware
