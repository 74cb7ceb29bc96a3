// A TCP server on loopback, in its own thread, that answers the first bytes of each connection and closes it.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>

#include <poll.h>
#include <sys/socket.h>

#include "common/tcp_listener.h"

namespace hord::test {

class AnsweringServer {
  public:
    // `answer` is called on the server's thread with what was sent. An empty answer: the connection only closes.
    explicit AnsweringServer(std::function<std::string(const std::string& sent)> answer)
        : answer_(std::move(answer)), listener_(listening()), thread_([this] { run(); }) {}
    ~AnsweringServer() {
        ::shutdown(listener_.get(), SHUT_RDWR);
        thread_.join();
    }
    [[nodiscard]] int port() const { return common::local_port(listener_.get()); }

  private:
    static common::UniqueFd listening() {
        auto listener = common::listen_on("test", "127.0.0.1", 0);
        if (!listener) throw std::runtime_error(listener.error().message());
        return std::move(*listener);
    }
    void run() {
        for (;;) {
            pollfd ready{listener_.get(), POLLIN, 0};
            if (::poll(&ready, 1, -1) < 0) continue;
            if ((ready.revents & POLLHUP) != 0) return;
            const common::UniqueFd client(::accept(listener_.get(), nullptr, nullptr));
            if (!client) continue;
            std::array<char, 300> bytes{};
            const ssize_t count = ::recv(client.get(), bytes.data(), bytes.size(), 0);
            const std::string answer = answer_({bytes.data(), static_cast<std::size_t>(std::max<ssize_t>(count, 0))});
            (void)::send(client.get(), answer.data(), answer.size(), MSG_NOSIGNAL);
        }
    }

    const std::function<std::string(const std::string&)> answer_;
    const common::UniqueFd listener_;
    std::thread thread_;
};

}  // namespace hord::test
