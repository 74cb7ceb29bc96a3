// One HTTP connection under cpp-httplib: bounded reads and writes, and a check of the request's head before the library
// parses it. Beside server.cpp the only file that uses cpp-httplib.
//
// A connection is used by one thread.
#pragma once

#include <atomic>
#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include <httplib.h>

namespace hord::firmware::page {

constexpr std::size_t kLargestHead = 8 * 1024, kLargestBody = 4 * 1024;

// Bytes from and to a client: a socket, or memory in tests.
class ByteStream {
  public:
    using Clock = std::chrono::steady_clock;
    virtual ~ByteStream() = default;
    // Bytes received; 0: the client has closed; -1: error, or nothing came until `until`.
    virtual ssize_t receive(char* into, std::size_t size, Clock::time_point until) = 0;
    virtual ssize_t send(const char* bytes, std::size_t size, Clock::time_point until) = 0;
    virtual bool alive() = 0;
    virtual std::pair<std::string, int> peer() const = 0;
    virtual socket_t socket() const = 0;
};

class SocketStream final : public ByteStream {
  public:
    // `waiting`: connections in the queue that no thread serves yet. `ending`: the server stops.
    SocketStream(socket_t fd, const std::atomic<bool>& ending, const std::atomic<int>& waiting)
        : fd_(fd), ending_(ending), waiting_(waiting) {}
    ssize_t receive(char* into, std::size_t size, Clock::time_point until) override;
    ssize_t send(const char* bytes, std::size_t size, Clock::time_point until) override;
    bool alive() override;
    std::pair<std::string, int> peer() const override;
    socket_t socket() const override { return fd_; }

  private:
    bool wait(short what, Clock::time_point until);
    const socket_t fd_;
    const std::atomic<bool>& ending_;
    const std::atomic<int>& waiting_;
};

// The stream that cpp-httplib reads requests from and writes replies to.
class Connection final : public httplib::Stream {
  public:
    using Clock = ByteStream::Clock;
    explicit Connection(ByteStream& stream) : stream_(stream) {}

    enum class Head : std::uint8_t { whole, none, too_large, malformed };
    // Reads the next request's head. Whole: read() returns it, without the header lines that this page ignores.
    Head next(std::chrono::seconds timeout);
    [[nodiscard]] bool has_body() const { return has_body_; }
    // From now on a reply may take as long as the client reads it.
    void begin_events() { events_ = true; }
    void send_text(std::string_view text);

    bool is_readable() const override { return !buffer_.empty(); }
    bool is_writable() const override { return stream_.alive(); }
    ssize_t read(char* into, std::size_t size) override;
    ssize_t write(const char* bytes, std::size_t size) override;
    void get_remote_ip_and_port(std::string& ip, int& port) const override { std::tie(ip, port) = stream_.peer(); }
    void get_local_ip_and_port(std::string& ip, int& port) const override {
        ip.clear();
        port = 0;
    }
    socket_t socket() const override { return stream_.socket(); }

  private:
    std::optional<std::string> checked_head(std::string_view head);

    ByteStream& stream_;
    std::string buffer_;
    std::size_t may_read_ = 0;
    Clock::time_point read_until_{}, reply_until_{};
    bool has_body_ = false, events_ = false;
};

}  // namespace hord::firmware::page
