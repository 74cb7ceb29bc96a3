// The service manager's side of the notification socket ($NOTIFY_SOCKET).
#pragma once

#include <cerrno>
#include <chrono>
#include <string>

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "tests/system/cli/service_fixture.h"

namespace hord::test {

class NotifySocket {
  public:
    explicit NotifySocket(const std::string& path) : fd_(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
        sockaddr_un address{};
        address.sun_family = AF_UNIX;
        path.copy(address.sun_path, sizeof address.sun_path - 1);
        EXPECT_EQ(bind(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    }
    ~NotifySocket() { close(fd_); }
    NotifySocket(const NotifySocket&) = delete;
    NotifySocket& operator=(const NotifySocket&) = delete;

    // From now on it takes no message, until hears() reads.
    void fill() const {
        sockaddr_un address{};
        socklen_t size = sizeof address;
        ASSERT_EQ(getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size), 0);
        while (sendto(fd_, "full", 4, MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&address), size) == 4) {
        }
        ASSERT_EQ(errno, EAGAIN);
    }

    // The next message that contains `text`; empty if none comes.
    std::string hears(const std::string& text) {
        const auto until = std::chrono::steady_clock::now() + kPatience;
        while (std::chrono::steady_clock::now() < until) {
            pollfd ready{fd_, POLLIN, 0};
            if (poll(&ready, 1, 1000) <= 0) continue;
            char bytes[4096];
            const ssize_t got = recv(fd_, bytes, sizeof bytes, 0);
            const std::string message(bytes, got > 0 ? static_cast<std::size_t>(got) : 0);
            if (message.find(text) != std::string::npos) return message;
        }
        return {};
    }

  private:
    int fd_;
};

}  // namespace hord::test
