// The reader of a DatagramQueue: systemd's side of the socket.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>

#include "common/unique_fd.h"

namespace hord::testing_support {

// Reads nothing until it is asked.
class DatagramReader {
  public:
    explicit DatagramReader(const std::string& path) : fd_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
        sockaddr_un address{};
        address.sun_family = AF_UNIX;
        path.copy(address.sun_path, sizeof address.sun_path - 1);
        EXPECT_EQ(::bind(fd_.get(), reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    }
    // All that waits.
    std::vector<std::string> read() {
        std::vector<std::string> all;
        std::vector<char> bytes(300'000);
        for (;;) {
            const ssize_t got = ::recv(fd_.get(), bytes.data(), bytes.size(), MSG_DONTWAIT);
            if (got < 0) return all;
            all.emplace_back(bytes.data(), static_cast<std::size_t>(got));
        }
    }

  private:
    common::UniqueFd fd_;
};

}  // namespace hord::testing_support
