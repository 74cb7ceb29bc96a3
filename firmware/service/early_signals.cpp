#include "firmware/service/early_signals.h"

#include <climits>
#include <csignal>

#include <poll.h>
#include <unistd.h>

namespace hord::firmware {
namespace {

constexpr int kHeld[] = {SIGINT, SIGTERM, SIGQUIT, SIGHUP};

std::string_view g_line;  // of end()

// Calls only what a signal's handler may call. A pipe that can be written takes PIPE_BUF bytes without waiting.
void end(int /*signal*/) {
    pollfd ready{STDERR_FILENO, POLLOUT, 0};
    if (g_line.size() <= PIPE_BUF && ::poll(&ready, 1, 0) > 0) [[maybe_unused]]
        const ssize_t written = ::write(STDERR_FILENO, g_line.data(), g_line.size());
    ::_exit(0);
}

sigset_t held() {
    sigset_t set;
    sigemptyset(&set);
    for (const int signal : kHeld) sigaddset(&set, signal);
    return set;
}

}  // namespace

bool is_ignored(int signal) {
    struct sigaction now {};
    return ::sigaction(signal, nullptr, &now) == 0 && now.sa_handler == SIG_IGN;
}

void hold_signals() {
    const sigset_t set = held();
    ::pthread_sigmask(SIG_BLOCK, &set, nullptr);
}

void release_signals() {
    const sigset_t set = held();
    ::pthread_sigmask(SIG_UNBLOCK, &set, nullptr);
}

void end_at_signals(std::string_view line, bool hangup_ends) {
    g_line = line;
    sigset_t released = held();
    struct sigaction action {};
    action.sa_handler = end;
    action.sa_mask = released;
    for (const int signal : kHeld) {
        if (signal == SIGHUP && (!hangup_ends || is_ignored(SIGHUP))) sigdelset(&released, signal);
        else ::sigaction(signal, &action, nullptr);
    }
    ::pthread_sigmask(SIG_UNBLOCK, &released, nullptr);
}

}  // namespace hord::firmware
