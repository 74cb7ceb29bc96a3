#include "common/file_writing.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <random>
#include <string>
#include <system_error>

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/dangling_link.h"
#include "common/regular_file.h"
#include "common/unique_fd.h"

namespace hord::common {

namespace fs = std::filesystem;

namespace {

// Gives a new file the owner, group and mode of the one that it replaces. Who may not give files away keeps the rest:
// the group, if it is one of the user's, and the mode.
int keep_access(int fd, const struct stat& old) {
    if (::fchown(fd, old.st_uid, old.st_gid) != 0) {
        if (errno != EPERM) return errno;
        if (::fchown(fd, static_cast<uid_t>(-1), old.st_gid) != 0 && errno != EPERM) return errno;
    }
    return ::fchmod(fd, old.st_mode & 0777) == 0 ? 0 : errno;
}

}  // namespace

int replace_file(const fs::path& file, const char* suffix, mode_t mode, bool sync, std::span<const std::byte> bytes) {
    char own[10];
    std::snprintf(own, sizeof own, ".%08x", std::random_device{}());
    const std::string unfinished = file.string() + own + suffix;
    UniqueFd fd(::open(unfinished.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode));
    if (!fd) return errno;
    struct stat old {};
    int error = ::lstat(file.c_str(), &old) == 0 && S_ISREG(old.st_mode) ? keep_access(fd.get(), old) : 0;
    if (error == 0) error = write_all(fd.get(), bytes);
    if (error == 0 && sync && ::fsync(fd.get()) != 0) error = errno;
    if (error == 0) error = fd.close();
    if (error == 0 && ::rename(unfinished.c_str(), file.c_str()) != 0) error = errno;
    if (error != 0) ::unlink(unfinished.c_str());
    return error;
}

Result<void> check_replaceable(const fs::path& file) {
    std::error_code error;
    const fs::file_type type = fs::symlink_status(file, error).type();
    const char* const what = type == fs::file_type::symlink ? "a symbolic link" : name_of_irregular(type);
    if (what == nullptr) return {};
    return fail(ErrorCode::refused, file.string() + " is " + what + ", not a regular file: it is not replaced",
                "give the name of a regular file");
}

std::error_code ensure_folder(const fs::path& folder) {
    std::error_code made, read;
    fs::create_directory(folder, made);
    if (fs::is_directory(folder, read)) return {};
    return made ? made : read ? read : std::make_error_code(std::errc::not_a_directory);
}

namespace {

Result<void> check_folder_of(const fs::path& file) {
    const fs::path folder = file.parent_path();
    if (std::error_code error; folder.empty() || fs::is_directory(folder, error)) return {};
    const std::string link = dangling_link(folder);
    return fail(ErrorCode::not_found, link.empty() ? "the folder " + folder.string() + " does not exist" : link,
                "create it first");
}

}  // namespace

Result<void> write_atomically(const fs::path& file, std::span<const std::uint8_t> bytes) {
    if (auto fine = check_folder_of(file); !fine) return fine;
    if (auto fine = check_replaceable(file); !fine) return fine;
    const int error = replace_file(file, ".part", 0666, false, std::as_bytes(bytes));
    if (error == 0) return {};
    return fail(ErrorCode::io, file.string() + " cannot be written (" + std::strerror(error) + ")",
                "check that its folder may be written to and has space");
}

Result<void> write_durably(const fs::path& file, std::string_view text) {
    if (auto fine = check_folder_of(file); !fine) return fine;
    if (auto fine = check_replaceable(file); !fine) return fine;
    int error = replace_file(file, ".new", 0644, true, std::as_bytes(std::span(text)));
    if (error == 0) error = sync_folder_of(file);
    if (error == 0) return {};
    return fail(ErrorCode::io, file.string() + " cannot be written: " + std::strerror(error),
                "check the folder's owner and the space on its disk");
}

std::optional<std::string> read_file(const fs::path& file, std::size_t most) {
    constexpr std::size_t kPiece = 1 << 16, kMaxPipe = std::size_t{64} << 20;
    constexpr int kPipeTimeout_ms = 5000;
    const UniqueFd fd(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY));
    struct stat what {};
    if (!fd || ::fstat(fd.get(), &what) != 0) return std::nullopt;
    if (S_ISCHR(what.st_mode) || S_ISBLK(what.st_mode)) {  // a terminal never ends
        errno = ENXIO;
        return std::nullopt;
    }
    const bool regular = S_ISREG(what.st_mode);
    if (!regular) most = std::min(most, kMaxPipe);
    std::string text;
    if (regular && static_cast<std::uint64_t>(what.st_size) > most) {
        errno = EFBIG;
        return std::nullopt;
    }
    if (regular) text.reserve(static_cast<std::size_t>(what.st_size));
    for (std::array<char, kPiece> piece;;) {
        const ssize_t count = ::read(fd.get(), piece.data(), piece.size());
        if (count == 0) {
            if (text.empty() && S_ISFIFO(what.st_mode)) errno = ENODATA;  // nobody writes into it
            else return text;
        } else if (count > 0 && text.size() + static_cast<std::size_t>(count) <= most) {
            text.append(piece.data(), static_cast<std::size_t>(count));
            continue;
        } else if (count > 0) {
            errno = EFBIG;
        } else if (errno == EINTR) {
            continue;
        } else if (errno == EAGAIN && !regular) {  // /proc/kmsg is regular, and waits for the next message
            pollfd readable{fd.get(), POLLIN, 0};
            if (::poll(&readable, 1, kPipeTimeout_ms) != 0) continue;
            errno = ETIMEDOUT;
        }
        return std::nullopt;
    }
}

Error cannot_read(const fs::path& file) {
    const int reason = errno;
    // A pipe that nobody writes into; a socket, a device.
    if (reason == ENODATA || reason == ENXIO) {
        if (auto regular = check_regular(file, "give a regular file"); !regular)
            return {ErrorCode::unreadable, regular.error().what, regular.error().cure};
    }
    const std::string link = reason == ENOENT ? dangling_link(file) : "";
    return {reason == ENOENT ? ErrorCode::not_found : ErrorCode::unreadable,
            fmt::format("{}: cannot be read ({})", file.string(), link.empty() ? std::strerror(reason) : link),
            reason == EISDIR      ? "give a file of this folder"
                : reason == EFBIG ? "it is larger than such a file can be, or never ends: give another file"
                                  : "check that the file exists and may be read"};
}

int write_all(int fd, std::span<const std::byte> bytes) {
    while (!bytes.empty()) {
        const ssize_t count = ::write(fd, bytes.data(), bytes.size());
        if (count < 0 && errno == EINTR) continue;
        if (count <= 0) return count == 0 ? EIO : errno;
        bytes = bytes.subspan(static_cast<std::size_t>(count));
    }
    return 0;
}

int sync_folder_of(const fs::path& file) {
    const fs::path folder = file.parent_path();
    const UniqueFd fd(::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    return fd && ::fsync(fd.get()) == 0 ? 0 : errno;
}

}  // namespace hord::common
