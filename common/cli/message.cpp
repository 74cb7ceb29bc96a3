#include "common/cli/message.h"

#include <cerrno>
#include <climits>
#include <mutex>

#include <poll.h>
#include <unistd.h>

namespace hord {
namespace {

std::mutex g_mutex;  // of what follows, and of stderr
bool g_waits = true;
std::size_t g_lost = 0;  // messages, since the last that was written

// Whether all of it was written. A pipe that can be written takes PIPE_BUF bytes without waiting; a file or a terminal
// does anyway.
bool write_all(std::string_view text) {
    while (!text.empty()) {
        pollfd ready{STDERR_FILENO, POLLOUT, 0};
        if (!g_waits) {
            const int there = ::poll(&ready, 1, 0);
            if (there == 0) return false;
            if (there < 0) continue;  // a signal
        }
        const ssize_t count = ::write(STDERR_FILENO, text.data(), std::min<std::size_t>(text.size(), PIPE_BUF));
        if (count < 0 && errno != EINTR) return false;
        if (count > 0) text.remove_prefix(static_cast<std::size_t>(count));
    }
    return true;
}

}  // namespace

void never_wait_for_stderr() {
    const std::lock_guard lock(g_mutex);
    g_waits = false;
}

bool write_message(std::string_view text) {
    const std::lock_guard lock(g_mutex);
    if (g_lost > 0 &&
        !write_all(fmt::format("{} message{} before this could not be written\n", g_lost, g_lost == 1 ? "" : "s"))) {
        ++g_lost;
        return false;
    }
    g_lost = write_all(text) ? 0 : 1;
    return g_lost == 0;
}

}  // namespace hord
