#include "firmware/station/state_lock.h"

#include <cerrno>
#include <string>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/file_writing.h"
#include "common/regular_file.h"

namespace hord::firmware {
namespace {

constexpr const char* kFile = "station.lock";

struct flock whole_file(short type) {
    struct flock range {};
    range.l_type = type;
    range.l_whence = SEEK_SET;
    return range;
}

// The kernel tells no process of a flock. It tells the one of a record lock, which a file of another user takes, too:
// what the file says would be the name of any earlier holder.
void sign(int file) {
    struct flock mark = whole_file(F_RDLCK);
    (void)::fcntl(file, F_SETLK, &mark);
}

// "process 4711 (hordd)". Empty: nobody has signed. The process is not known in another container or on another
// machine.
std::string signed_by(int file) {
    struct flock mark = whole_file(F_WRLCK);
    if (::fcntl(file, F_GETLK, &mark) != 0 || mark.l_type == F_UNLCK) return {};
    if (mark.l_pid <= 0) return "another process";
    std::string name = common::read_file(fmt::format("/proc/{}/comm", mark.l_pid)).value_or("");
    while (!name.empty() && name.back() == '\n') name.pop_back();
    return fmt::format("process {}{}", mark.l_pid, name.empty() ? "" : " (" + name + ")");
}

// Never waits: opening a pipe without a writer would.
common::UniqueFd open_lock(const std::filesystem::path& path, int flags) {
    return common::UniqueFd(::open(path.c_str(), flags | O_CLOEXEC | O_NONBLOCK | O_NOCTTY, 0644));
}

std::string is_in_use(const std::string& what, const std::filesystem::path& folder, const std::string& holder) {
    return what + " " + folder.string() + " is in use by " + (holder.empty() ? "another process" : holder);
}

}  // namespace

Result<StateLock> StateLock::take(const std::filesystem::path& folder, const std::string& what) {
    StateLock lock;
    lock.path_ = folder;
    lock.what_ = what;
    if (auto fine = check_file(folder); !fine) return tl::unexpected(fine.error());
    const std::filesystem::path file = folder / kFile;
    const auto is_free = [](common::UniqueFd& held) {
        if (!held || ::flock(held.get(), LOCK_EX | LOCK_NB) == 0) return true;
        if (errno == EWOULDBLOCK) return false;
        return true;  // a file system without such locks
    };
    lock.folder_ = open_lock(folder, O_RDONLY | O_DIRECTORY);
    bool free = is_free(lock.folder_);
    if (free) {
        lock.file_ = open_lock(file, O_RDWR | O_CREAT);
        if (!lock.file_) lock.file_ = open_lock(file, O_RDONLY);  // another user's, or read-only
        free = is_free(lock.file_);
    }
    if (!free) {
        return fail(ErrorCode::busy, in_use(folder, what).value_or(is_in_use(what, folder, "")),
                    "stop it or name another folder");
    }
    if (lock.file_) sign(lock.file_.get());
    return lock;
}

Result<void> StateLock::check_file(const std::filesystem::path& folder) {
    const std::filesystem::path file = folder / kFile;
    std::error_code none;
    if (std::filesystem::is_directory(file, none)) return {};  // cannot be opened as a lock: the folder's is held
    return common::check_regular(file, "remove it: the station makes its lock there");
}

Result<void> StateLock::check_place() const {
    struct stat held {
    }, now{};
    if (!folder_ || ::fstat(folder_.get(), &held) != 0) return {};
    if (::stat(path_.c_str(), &now) == 0 && now.st_dev == held.st_dev && now.st_ino == held.st_ino) return {};
    return fail(ErrorCode::refused,
                what_ + " " + path_.string() + " was renamed or removed since the start: nothing is written there",
                "stop the station, put its folder back, start again");
}

std::optional<std::string> StateLock::in_use(const std::filesystem::path& folder, const std::string& what) {
    const common::UniqueFd file = open_lock(folder / kFile, O_RDONLY);
    const std::string holder = file ? signed_by(file.get()) : std::string();
    return holder.empty() ? std::nullopt : std::optional(is_in_use(what, folder, holder));
}

}  // namespace hord::firmware
