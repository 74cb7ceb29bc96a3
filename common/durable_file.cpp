#include "common/durable_file.h"

#include <cerrno>
#include <cstring>
#include <string>

#include <fcntl.h>
#include <unistd.h>

namespace hord::common {
namespace {

tl::unexpected<Error> io_error(const std::filesystem::path& file) {
    return fail(ErrorCode::io, file.string() + " cannot be written: " + std::strerror(errno),
                "check the folder's owner and the space on its disk");
}

bool write_all(int fd, std::string_view text) {
    while (!text.empty()) {
        const ssize_t count = ::write(fd, text.data(), text.size());
        if (count < 0 && errno == EINTR) continue;
        if (count <= 0) return false;
        text.remove_prefix(static_cast<std::size_t>(count));
    }
    return ::fsync(fd) == 0;
}

}  // namespace

Result<void> write_durably(const std::filesystem::path& file, std::string_view text) {
    const std::string beside = file.string() + ".new";
    const int fd = ::open(beside.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (fd < 0) return io_error(file);
    const bool written = write_all(fd, text);
    const bool closed = ::close(fd) == 0;
    if (!written || !closed || ::rename(beside.c_str(), file.c_str()) != 0) {
        const auto error = io_error(file);
        ::unlink(beside.c_str());
        return error;
    }
    const int folder =
        ::open(file.parent_path().empty() ? "." : file.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder < 0) return io_error(file);
    const bool synced = ::fsync(folder) == 0;
    ::close(folder);
    return synced ? Result<void>{} : io_error(file);
}

}  // namespace hord::common
