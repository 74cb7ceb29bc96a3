#include "drivers/gardasoft/gardasoft_link.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <memory>

#include <fcntl.h>
#include <netdb.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <termios.h>

namespace hord::drivers {
namespace {

using hal::Duration;
using std::chrono::steady_clock;

std::string reason(int error) { return std::strerror(error); }

// True when `fd` is ready before `until`.
bool wait_for(int fd, short what, steady_clock::time_point until) {
    for (;;) {
        const auto left =
            std::chrono::ceil<std::chrono::milliseconds>(std::max(until - steady_clock::now(), Duration::zero()));
        pollfd wanted{fd, what, 0};
        const int ready = poll(&wanted, 1, static_cast<int>(left.count()));
        if (ready > 0) return true;
        if (ready == 0 || errno != EINTR) return false;
    }
}

// A socket that the other side has closed must not raise SIGPIPE.
ssize_t send_some(int fd, std::string_view bytes) {
    const ssize_t count = ::send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    return count < 0 && errno == ENOTSOCK ? ::write(fd, bytes.data(), bytes.size()) : count;
}

Result<common::UniqueFd> open_serial(const std::string& device) {
    common::UniqueFd fd(::open(device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
    if (!fd) {
        const int error = errno;
        return fail(error == ENOENT ? ErrorCode::not_found : ErrorCode::io,
                    "the strobe controller's serial line " + device + " cannot be opened: " + reason(error),
                    error == EACCES ? "add the service's user to the line's group (dialout)" : "check strobe.device");
    }
    if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0)
        return fail(ErrorCode::busy, "the strobe controller's serial line " + device + " is in use",
                    "stop the program that holds it");
    termios line{};
    if (tcgetattr(fd.get(), &line) != 0)
        return fail(ErrorCode::invalid_argument, device + " is no serial line", "check strobe.device");
    cfmakeraw(&line);
    line.c_cflag |= CLOCAL | CREAD;
    line.c_cflag &= ~static_cast<tcflag_t>(CSTOPB | PARENB | CRTSCTS);
    cfsetspeed(&line, B115200);
    if (tcsetattr(fd.get(), TCSANOW, &line) != 0)
        return fail(ErrorCode::io, device + " cannot be set to 115200 baud: " + reason(errno), "use another adapter");
    tcflush(fd.get(), TCIOFLUSH);
    return fd;
}

Result<common::UniqueFd> open_tcp(const std::string& host, int port) {
    const std::string where = "the strobe controller at " + host + ":" + std::to_string(port);
    addrinfo hints{};
    hints.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    if (const int error = getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found); error != 0)
        return fail(ErrorCode::not_found, where + " is not known: " + gai_strerror(error), "check strobe.host");
    const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(found, &freeaddrinfo);
    common::UniqueFd fd(::socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    if (!fd) return fail(ErrorCode::io, "no socket for " + where + ": " + reason(errno), "check the open files' limit");
    int error = 0;
    if (::connect(fd.get(), found->ai_addr, found->ai_addrlen) != 0) error = errno;
    if (error == EINPROGRESS) {
        if (!wait_for(fd.get(), POLLOUT, steady_clock::now() + GardasoftLink::kConnectTimeout))
            return fail(ErrorCode::timeout, where + " does not answer",
                        "check its power, the cable and strobe.host; GardasoftMaint lists the controllers");
        socklen_t size = sizeof error;
        getsockopt(fd.get(), SOL_SOCKET, SO_ERROR, &error, &size);
    }
    if (error == ECONNREFUSED)
        return fail(ErrorCode::busy, where + " refuses the connection",
                    "is another program connected to it? else check strobe.host and strobe.port");
    if (error != 0)
        return fail(ErrorCode::disconnected, where + " cannot be reached: " + reason(error),
                    "check its power, the cable and strobe.host");
    const int yes = 1;
    setsockopt(fd.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    return fd;
}

}  // namespace

Result<GardasoftLink> GardasoftLink::open(const GardasoftStrobeOptions& options) {
    const bool serial = !options.device.empty();
    auto fd = serial ? open_serial(options.device) : open_tcp(options.host, options.port);
    if (!fd) return tl::unexpected(fd.error());
    return GardasoftLink(
        std::move(*fd),
        "the strobe controller at " + (serial ? options.device : options.host + ":" + std::to_string(options.port)),
        options.response_timeout);
}

Result<std::string> GardasoftLink::ask(std::string_view command) {
    const auto gone = [&](const std::string& why) {
        return fail(ErrorCode::disconnected, name_ + " is gone: " + why, "check its power and the cable, then reset");
    };
    const auto until = steady_clock::now() + timeout_;
    const std::string line = std::string(command) + "\r";
    for (std::size_t sent = 0; sent < line.size();) {
        const ssize_t count = send_some(fd_.get(), std::string_view(line).substr(sent));
        if (count > 0) sent += static_cast<std::size_t>(count);
        else if (errno == EAGAIN && wait_for(fd_.get(), POLLOUT, until)) continue;
        else if (errno != EINTR) return gone(reason(errno));
    }
    std::string raw;
    while (raw.empty() || raw.back() != '>') {
        if (raw.size() > kMaxReply)
            return fail(ErrorCode::unreadable, name_ + " sends text without an end",
                        "is it a Gardasoft controller of the RT series?");
        if (!wait_for(fd_.get(), POLLIN, until))
            return fail(ErrorCode::timeout,
                        name_ + " does not answer \"" + std::string(command) + "\" within " +
                            std::to_string(timeout_ / std::chrono::milliseconds(1)) + " ms",
                        raw.empty() ? "check its power and the cable, then reset"
                                    : "is it a Gardasoft controller of the RT series?");
        std::array<char, 512> bytes{};
        const ssize_t count = ::read(fd_.get(), bytes.data(), bytes.size());
        if (count > 0) raw.append(bytes.data(), static_cast<std::size_t>(count));
        else if (count == 0) return gone("it closed the connection");
        else if (errno != EAGAIN && errno != EINTR) return gone(reason(errno));
    }
    return gardasoft::text_of_reply(command, raw);
}

}  // namespace hord::drivers
