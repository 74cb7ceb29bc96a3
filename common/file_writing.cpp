#include "common/file_writing.h"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <string>
#include <system_error>

#include <fcntl.h>
#include <unistd.h>

#include "common/unique_fd.h"

namespace hord::common {

namespace fs = std::filesystem;

Result<void> write_atomically(const fs::path& file, std::span<const std::uint8_t> bytes) {
    const fs::path folder = file.parent_path();
    if (std::error_code error; !folder.empty() && !fs::is_directory(folder, error)) {
        return fail(ErrorCode::not_found, "the folder " + folder.string() + " does not exist", "create it first");
    }
    const fs::path unfinished = file.string() + ".part";
    std::ofstream out(unfinished, std::ios::binary);
    out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    out.close();
    std::error_code error;
    if (out) fs::rename(unfinished, file, error);
    if (out && !error) return {};
    const std::string why = error ? " (" + error.message() + ")" : "";
    fs::remove(unfinished, error);
    return fail(ErrorCode::io, file.string() + " cannot be written" + why,
                "check that its folder may be written to and has space");
}

Result<void> write_durably(const fs::path& file, std::string_view text) {
    const std::string unfinished = file.string() + ".new";
    UniqueFd fd(::open(unfinished.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
    const bool opened = static_cast<bool>(fd);
    int error = opened ? write_all(fd.get(), std::as_bytes(std::span(text))) : errno;
    if (error == 0 && ::fsync(fd.get()) != 0) error = errno;
    if (error == 0) error = fd.close();
    if (error == 0 && ::rename(unfinished.c_str(), file.c_str()) != 0) error = errno;
    if (error != 0 && opened) ::unlink(unfinished.c_str());
    if (error == 0) error = sync_folder_of(file);
    if (error == 0) return {};
    return fail(ErrorCode::io, file.string() + " cannot be written: " + std::strerror(error),
                "check the folder's owner and the space on its disk");
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
