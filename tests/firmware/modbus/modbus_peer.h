// A raw TCP peer that may misbehave, and a register model for the server.
#pragma once

#include <cstdint>
#include <vector>

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "firmware/modbus/tcp_server.h"
#include "firmware/plc/register_server_model.h"
#include "firmware/registers/register_client.h"
#include "tests/firmware/modbus/modbus_poll_loop.h"

namespace hord::firmware::modbus {

using Bytes = std::vector<std::uint8_t>;

// Time limit far above any correct answer; a test fails when it reaches it.
inline constexpr int kPatienceMs = 20'000;
inline constexpr std::chrono::milliseconds kPatience{kPatienceMs};

// Reads register 2 and 3, the magic; the reply has 13 bytes.
inline const Bytes kReadMagic{0x12, 0x34, 0, 0, 0, 6, 1, 3, 0, 2, 0, 2};
inline const Bytes kMagicReply{0x12, 0x34, 0, 0, 0, 7, 1, 3, 4, 'H', 'O', 'R', 'D'};

class Peer {
  public:
    // `from`: last byte of the address 127.0.0.x that it connects from; 0: the system chooses.
    explicit Peer(std::uint16_t port, int receive_buffer = 0, std::uint8_t from = 0)
        : fd_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
        if (receive_buffer > 0) ::setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
        const int on = 1;
        ::setsockopt(fd_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK - 1 + from);
        if (from != 0) (void)::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address);
        address.sin_port = htons(port);
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        connected_ = ::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    }
    Peer(Peer&& other) noexcept : fd_(std::exchange(other.fd_, -1)), connected_(other.connected_) {}
    Peer& operator=(Peer&&) = delete;
    ~Peer() {
        if (fd_ >= 0) ::close(fd_);
    }
    [[nodiscard]] bool connected() const { return connected_; }
    // Returns the number of bytes that the kernel accepted. Fewer than all: the other side does not read, or has
    // closed.
    std::size_t send(const Bytes& bytes) {
        std::size_t sent = 0;
        while (sent < bytes.size()) {
            const auto count = ::send(fd_, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL | MSG_DONTWAIT);
            if (count <= 0) break;
            sent += static_cast<std::size_t>(count);
        }
        return sent;
    }
    // Exactly `size` bytes, or fewer when the connection ends first.
    Bytes receive(std::size_t size) {
        Bytes all(size);
        std::size_t filled = 0;
        while (filled < size) {
            pollfd ready{fd_, POLLIN, 0};
            if (::poll(&ready, 1, kPatienceMs) <= 0) {
                ADD_FAILURE() << "no answer";
                break;
            }
            const auto count = ::recv(fd_, all.data() + filled, size - filled, 0);
            if (count <= 0) break;
            filled += static_cast<std::size_t>(count);
        }
        all.resize(filled);
        return all;
    }
    bool asks() { return send(kReadMagic) == kReadMagic.size() && receive(kMagicReply.size()) == kMagicReply; }
    // True when the server closes this connection.
    bool closed_by_server() { return receive(1).empty(); }

  private:
    int fd_;
    bool connected_ = false;
};

class ServedStation : public ::testing::Test {
  protected:
    PollLoop loop;
    RegisterServerModel image{StationIdentity{.firmware = "0.1.0", .serial = "H-0042", .boot_id = 0xB007}};
    std::unique_ptr<Server> server;
    std::uint16_t port = 0;

    void serve(ServerOptions options) {
        options.host = "127.0.0.1";
        options.port = 0;
        auto opened = loop.on_loop([&] { return Server::open(loop, image, options); });
        ASSERT_TRUE(opened) << opened.error().message();
        server = std::move(*opened);
        port = server->port();
    }
    void SetUp() override { serve({}); }
    void TearDown() override {
        loop.on_loop([&] { server.reset(); });
    }
    ServerStatistics statistics() {
        return loop.on_loop([&] { return server->statistics(); });
    }
    Client client() {
        auto made = Client::connect({"127.0.0.1", port}, kPatience);
        if (!made) throw std::runtime_error(made.error().message());
        return std::move(*made);
    }
};

}  // namespace hord::firmware::modbus
