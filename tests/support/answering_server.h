// TCP servers on loopback, each in its own thread.
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

// Serves one connection after the other.
class LoopbackServer {
  public:
    // `serve` is called on the server's thread with each connection, which is closed when it returns.
    explicit LoopbackServer(std::function<void(int client)> serve)
        : serve_(std::move(serve)), listener_(listening()), thread_([this] { run(); }) {}
    ~LoopbackServer() {
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
            pollfd ready{listener_.get(), POLLIN, 0};  // it does not block
            if (::poll(&ready, 1, -1) < 0) continue;
            if ((ready.revents & POLLHUP) != 0) return;
            if (const common::UniqueFd client(::accept(listener_.get(), nullptr, nullptr)); client)
                serve_(client.get());
        }
    }

    const std::function<void(int)> serve_;
    const common::UniqueFd listener_;
    std::thread thread_;
};

// Answers the first bytes of each connection and closes it.
class AnsweringServer : public LoopbackServer {
  public:
    // `answer` is called on the server's thread with what was sent. An empty answer: the connection only closes.
    explicit AnsweringServer(std::function<std::string(const std::string& sent)> answer)
        : LoopbackServer([answer = std::move(answer)](int client) {
              std::array<char, 300> bytes{};
              const ssize_t count = ::recv(client, bytes.data(), bytes.size(), 0);
              const std::string said = answer({bytes.data(), static_cast<std::size_t>(std::max<ssize_t>(count, 0))});
              (void)::send(client, said.data(), said.size(), MSG_NOSIGNAL);
          }) {}
};

}  // namespace hord::test
