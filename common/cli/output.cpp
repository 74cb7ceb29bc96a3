#include "common/cli/output.h"

#include <algorithm>
#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstring>
#include <string>
#include <utility>

#include <poll.h>
#include <unistd.h>

#include "common/cli/program.h"

namespace hord {
namespace {

int g_reason = 0;

const char* cure_of(int reason) {
    switch (reason) {
        case EPIPE: return "let its reader read to the end";
        case EBADF: return "start it with a stdout that can be written: a file, a pipe or a terminal";
        case 0:
        case EDQUOT:
        case EFBIG:
        case ENOSPC: return "see that its disk has space";
        default: return "check the file, the device or the program that takes it";
    }
}

}  // namespace

void print_output(std::string_view text) {
    if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size()) note_lost_output(errno);
}

// A pipe that can be written takes so many bytes without waiting (PIPE_BUF); a file or a terminal does anyway.
Written write_output(std::string_view text, int patience_ms) {
    Written written;
    while (written.reason == 0 && written.bytes < text.size()) {
        pollfd ready{STDOUT_FILENO, POLLOUT, 0};
        if (::poll(&ready, 1, patience_ms) == 0) break;
        const ssize_t count = ::write(STDOUT_FILENO, text.data() + written.bytes,
                                      std::min<std::size_t>(text.size() - written.bytes, PIPE_BUF));
        if (count >= 0) written.bytes += static_cast<std::size_t>(count);
        else if (errno != EINTR && errno != EAGAIN) written.reason = errno;
    }
    return written;
}

Error lost_output(int reason) {
    const std::string why = reason == 0 ? "" : std::string(" (") + std::strerror(reason) + ")";
    return {ErrorCode::io, "the output could not be written" + why, cure_of(reason)};
}

void note_lost_output(int reason) {
    if (g_reason == 0) g_reason = reason;
}

int end_output(int status) {
    static bool told = false;
    const bool lost = std::ferror(stdout) != 0;
    if (told || (std::fflush(stdout) == 0 && !lost)) return status;
    told = true;
    if (!lost) note_lost_output(errno);
    return static_cast<int>(complain(lost_output(g_reason)));
}

}  // namespace hord
