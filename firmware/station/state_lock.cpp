#include "firmware/station/state_lock.h"

#include <cerrno>
#include <string>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include "common/file_writing.h"

namespace hord::firmware {
namespace {

// "process 4711 (hordd)"
std::string owner_of(const std::filesystem::path& file) {
    const std::string owner = common::read_file(file).value_or("");
    return owner.empty() ? "another process" : "process " + owner;
}

// On a full disk the file stays empty, and the owner is not known.
void write_owner(int file) {
    const std::string owner = fmt::format("{} ({})", ::getpid(), program_invocation_short_name);
    if (::ftruncate(file, 0) != 0 || ::pwrite(file, owner.data(), owner.size(), 0) < 0) return;
}

}  // namespace

Result<StateLock> StateLock::take(const std::filesystem::path& folder, const std::string& what) {
    StateLock lock;
    const std::filesystem::path file = folder / "station.lock";
    lock.file_.reset(::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
    if (!lock.held()) lock.file_.reset(::open(file.c_str(), O_RDONLY | O_CLOEXEC));  // another user's, or read-only
    if (!lock.held()) return lock;
    if (::flock(lock.file_.get(), LOCK_EX | LOCK_NB) == 0) {
        write_owner(lock.file_.get());
        return lock;
    }
    if (errno == EWOULDBLOCK) {
        return fail(ErrorCode::busy, what + " " + folder.string() + " is in use by " + owner_of(file),
                    "stop it or name another folder");
    }
    lock.file_.reset();  // a file system without locks
    return lock;
}

}  // namespace hord::firmware
