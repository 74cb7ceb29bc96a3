#include "common/tcp_listener.h"

#include <cerrno>
#include <charconv>
#include <cstring>

#include <fmt/format.h>
#include <netdb.h>

namespace hord::common {
namespace {

constexpr int kBacklog = 1024;

tl::unexpected<Error> listen_error(std::string_view what, const std::string& host, std::uint16_t port, int error) {
    const std::string where = fmt::format("{} port {} on {}", what, port, host);
    switch (error) {
        case EADDRINUSE:
            return fail(
                ErrorCode::busy, where + " is taken by another program",
                fmt::format("choose another port, or stop the program that `ss -ltnp 'sport = :{}'` names", port));
        case EACCES:
        case EPERM:
            return fail(ErrorCode::refused, where + " may not be opened by this user",
                        "choose a port from 1024 up, or let systemd open it (socket activation)");
        case EADDRNOTAVAIL:
            return fail(ErrorCode::not_found, host + " is not an address of this machine",
                        "choose one that `ip address` lists, or 0.0.0.0 for all");
        default:
            return fail(ErrorCode::io, fmt::format("{} cannot be opened: {}", where, std::strerror(error)),
                        "check the network");
    }
}

}  // namespace

Result<UniqueFd> listen_on(std::string_view what, const std::string& host, std::uint16_t port) {
    addrinfo hints{};
    hints.ai_flags = AI_PASSIVE | AI_NUMERICHOST | AI_NUMERICSERV;
    hints.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    const std::string numeric = host == "localhost" ? "127.0.0.1" : host;
    if (::getaddrinfo(numeric.c_str(), std::to_string(port).c_str(), &hints, &found) != 0) {
        return fail(ErrorCode::invalid_argument, fmt::format("\"{}\" is not a network address to listen on", host),
                    "give an IPv4 or IPv6 address of this machine, or 0.0.0.0 for all");
    }
    UniqueFd fd(::socket(found->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    const int on = 1;
    ::setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    const bool good =
        fd && ::bind(fd.get(), found->ai_addr, found->ai_addrlen) == 0 && ::listen(fd.get(), kBacklog) == 0;
    const int error = errno;
    ::freeaddrinfo(found);
    if (!good) return listen_error(what, host, port, error);
    return fd;
}

std::string address_text(const sockaddr_storage& address, socklen_t length) {
    char host[NI_MAXHOST] = "?", port[NI_MAXSERV] = "?";
    ::getnameinfo(reinterpret_cast<const sockaddr*>(&address), length, host, sizeof host, port, sizeof port,
                  NI_NUMERICHOST | NI_NUMERICSERV);
    return address.ss_family == AF_INET6 ? fmt::format("[{}]:{}", host, port) : fmt::format("{}:{}", host, port);
}

std::string_view host_of(std::string_view address) { return address.substr(0, address.rfind(':')); }

std::string resolve_problem(const std::string& host) {
    addrinfo hints{};
    hints.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    if (const int error = ::getaddrinfo(host.c_str(), nullptr, &hints, &found); error != 0)
        return fmt::format("the host name cannot be resolved ({})", ::gai_strerror(error));
    ::freeaddrinfo(found);
    return {};
}

std::string local_address(int fd) {
    sockaddr_storage address{};
    socklen_t length = sizeof address;
    if (::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &length) != 0) return {};
    return address_text(address, length);
}

std::uint16_t local_port(int fd) {
    const std::string address = local_address(fd);
    std::uint16_t port = 0;
    if (const auto colon = address.rfind(':'); colon != std::string::npos)
        std::from_chars(address.data() + colon + 1, address.data() + address.size(), port);
    return port;
}

}  // namespace hord::common
