// What tests of `hordctl run` share: ports, and what a run says.
#pragma once

#include <chrono>
#include <sstream>
#include <string>
#include <vector>

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <nlohmann/json.hpp>
#include <sys/socket.h>
#include <unistd.h>

#include "tests/system/cli/program.h"

namespace hord::test {

using Json = nlohmann::json;

inline constexpr auto kRendering = std::chrono::seconds(240);  // of the simulated parts, on a busy machine

// A TCP port of this machine, held (and, if asked, listening without ever answering) for the test's life.
class HeldPort {
  public:
    explicit HeldPort(bool listening) : fd_(socket(AF_INET, SOCK_STREAM, 0)) {
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof address;
        EXPECT_EQ(bind(fd_, reinterpret_cast<sockaddr*>(&address), size), 0);
        EXPECT_EQ(getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size), 0);
        port_ = ntohs(address.sin_port);
        if (listening) {
            EXPECT_EQ(listen(fd_, 16), 0);
        }
    }
    ~HeldPort() { close(fd_); }
    HeldPort(const HeldPort&) = delete;
    HeldPort& operator=(const HeldPort&) = delete;
    [[nodiscard]] std::string address() const { return "127.0.0.1:" + std::to_string(port_); }
    [[nodiscard]] int port() const { return port_; }

  private:
    int fd_;
    int port_ = 0;
};

inline std::vector<Json> json_lines(const std::string& text) {
    std::vector<Json> all;
    std::istringstream stream(text);
    for (std::string line; std::getline(stream, line);) {
        if (!line.empty() && line.front() == '{') all.push_back(Json::parse(line));
    }
    return all;
}

// The port that a running station said it listens at.
inline std::string port_of(const Said& said) {
    const std::string mark = "registers at 127.0.0.1:";
    const auto at = said.err.find(mark);
    return at == std::string::npos ? "" : said.err.substr(at + mark.size(), said.err.find('\n', at) - at - mark.size());
}

}  // namespace hord::test
