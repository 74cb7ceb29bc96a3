#include "firmware/page/http_connection.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <tuple>

#include <poll.h>

#include "firmware/page/page_config.h"

namespace hord::firmware::page {
namespace {

constexpr auto kReadTimeout = std::chrono::seconds(5);   // of a body, from the end of its head
constexpr auto kWriteTimeout = std::chrono::seconds(5);  // of one write
constexpr auto kReplyTimeout = std::chrono::seconds(30);
constexpr auto kBusyIdleTimeout = std::chrono::milliseconds(400);  // of a silent client while others wait
constexpr auto kSlice = std::chrono::milliseconds(200);            // a stopping server is noticed within this time

}  // namespace

ssize_t SocketStream::receive(char* into, std::size_t size, Clock::time_point until) {
    return wait(POLLIN, until) ? ::recv(fd_, into, size, MSG_DONTWAIT) : -1;
}

ssize_t SocketStream::send(const char* bytes, std::size_t size, Clock::time_point until) {
    return wait(POLLOUT, until) ? ::send(fd_, bytes, size, MSG_NOSIGNAL | MSG_DONTWAIT) : -1;
}

bool SocketStream::alive() {
    pollfd state{fd_, POLLRDHUP, 0};
    return !ending_ && ::poll(&state, 1, 0) >= 0 && (state.revents & (POLLRDHUP | POLLHUP | POLLERR)) == 0;
}

std::pair<std::string, int> SocketStream::peer() const {
    sockaddr_storage address{};
    socklen_t size = sizeof address;
    char host[NI_MAXHOST] = "", port[NI_MAXSERV] = "0";
    if (::getpeername(fd_, reinterpret_cast<sockaddr*>(&address), &size) != 0) return {"?", 0};
    if (::getnameinfo(reinterpret_cast<sockaddr*>(&address), size, host, sizeof host, port, sizeof port,
                      NI_NUMERICHOST | NI_NUMERICSERV) != 0)
        return {"?", 0};
    return {host, std::atoi(port)};
}

bool SocketStream::wait(short what, Clock::time_point until) {
    const auto began = Clock::now();
    while (!ending_) {
        if (what == POLLIN && waiting_ > 0 && Clock::now() - began > kBusyIdleTimeout) return false;
        const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now());
        if (left.count() <= 0) return false;
        pollfd state{fd_, what, 0};
        const int ready =
            ::poll(&state, 1, static_cast<int>(std::min<std::chrono::milliseconds>(left, kSlice).count()));
        if (ready > 0) return true;
        if (ready < 0 && errno != EINTR) return false;
    }
    return false;
}

Connection::Head Connection::next(std::chrono::seconds timeout) {
    const auto until = Clock::now() + timeout;
    std::size_t end = std::string::npos;
    while ((end = buffer_.find("\r\n\r\n")) == std::string::npos) {
        if (buffer_.size() > kLargestHead) return Head::too_large;
        char bytes[4096];
        const ssize_t got = stream_.receive(bytes, sizeof bytes, until);
        if (got <= 0) return Head::none;
        buffer_.append(bytes, static_cast<std::size_t>(got));
    }
    if (end > kLargestHead) return Head::too_large;
    end += 4;
    auto checked = checked_head(std::string_view(buffer_).substr(0, end));
    if (!checked) return Head::malformed;
    buffer_.replace(0, end, *checked);
    may_read_ = checked->size() + kLargestBody + 1;  // one byte above the limit: httplib detects the excess
    read_until_ = Clock::now() + kReadTimeout;
    reply_until_ = Clock::now() + kReplyTimeout;
    events_ = false;
    return Head::whole;
}

void Connection::send_text(std::string_view text) {
    (void)stream_.send(text.data(), text.size(), Clock::now() + kSlice);
}

ssize_t Connection::read(char* into, std::size_t size) {
    size = std::min(size, may_read_);
    if (size == 0) return -1;
    ssize_t got = 0;
    if (!buffer_.empty()) {
        got = static_cast<ssize_t>(std::min(size, buffer_.size()));
        std::memcpy(into, buffer_.data(), static_cast<std::size_t>(got));
        buffer_.erase(0, static_cast<std::size_t>(got));
    } else {
        got = stream_.receive(into, size, read_until_);
    }
    if (got > 0) may_read_ -= static_cast<std::size_t>(got);
    return got;
}

ssize_t Connection::write(const char* bytes, std::size_t size) {
    const auto soon = Clock::now() + kWriteTimeout;
    return stream_.send(bytes, size, events_ ? soon : std::min(soon, reply_until_));
}

// Empty for a head that no browser sends: control characters, folded lines, a head without a colon, Host or
// Content-Length twice. Range is removed: every reply is whole.
std::optional<std::string> Connection::checked_head(std::string_view head) {
    std::string out;
    int hosts = 0, lengths = 0, number = 0;
    has_body_ = false;
    while (head != "\r\n") {
        const auto end = head.find("\r\n");
        const std::string_view line = head.substr(0, end);
        head.remove_prefix(end + 2);
        for (const char c : line) {
            if ((static_cast<unsigned char>(c) < 0x20 && c != '\t') || c == 0x7F) return std::nullopt;
        }
        if (number++ == 0) {
            if (line.find('\t') != std::string_view::npos) return std::nullopt;
            out.append(line).append("\r\n");
            continue;
        }
        const auto colon = line.find(':');
        if (colon == std::string_view::npos || colon == 0 ||
            line.substr(0, colon).find_first_of(" \t") != std::string_view::npos)
            return std::nullopt;
        const std::string name = lower(line.substr(0, colon));
        hosts += name == "host" ? 1 : 0;
        lengths += name == "content-length" ? 1 : 0;
        has_body_ = has_body_ || name == "content-length" || name == "transfer-encoding";
        if (name == "range" || name == "if-range") continue;
        out.append(line).append("\r\n");
    }
    if (hosts > 1 || lengths > 1) return std::nullopt;
    return out + "\r\n";
}

}  // namespace hord::firmware::page
