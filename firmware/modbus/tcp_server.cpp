#include "firmware/modbus/tcp_server.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <tuple>
#include <utility>
#include <vector>

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/assign.h"
#include "common/unique_fd.h"

namespace hord::firmware::modbus {
namespace {

using namespace std::chrono_literals;

constexpr int kBacklog = 1024;
constexpr int kAcceptsPerTurn = 8;
constexpr int kServedPerTurn = 32;         // connections served in one callback of the loop
constexpr std::uint64_t kEstablished = 8;  // completed requests of an established client
constexpr auto kEstablishedIdle = 10s;     // longest silence of one
constexpr auto kPauseWithoutDescriptors = 100ms;

// One turn reads at most kInputSize bytes, and only when every earlier reply has been sent. The shortest request with a
// reply of full size has 11 bytes: at most 264 / 11 + 1 = 25 replies of at most 260 bytes, 6500 bytes.
constexpr std::size_t kInputSize = 264;
constexpr std::size_t kOutputSize = 8192;
static_assert((kInputSize / 11 + 1) * kMaxTcpFrame <= kOutputSize);

std::string address_of(const sockaddr_storage& address, socklen_t length) {
    char host[NI_MAXHOST] = "?", port[NI_MAXSERV] = "?";
    ::getnameinfo(reinterpret_cast<const sockaddr*>(&address), length, host, sizeof host, port, sizeof port,
                  NI_NUMERICHOST | NI_NUMERICSERV);
    return address.ss_family == AF_INET6 ? fmt::format("[{}]:{}", host, port) : fmt::format("{}:{}", host, port);
}

void set_option(int fd, int level, int option, int value) { ::setsockopt(fd, level, option, &value, sizeof value); }

tl::unexpected<Error> listen_error(const ServerOptions& options, int error) {
    const std::string where = fmt::format("Modbus port {} on {}", options.port, options.host);
    switch (error) {
        case EADDRINUSE:
            return fail(ErrorCode::busy, where + " is taken by another program",
                        fmt::format("choose another port, or stop the program that `ss -ltnp 'sport = :{}'` names",
                                    options.port));
        case EACCES:
        case EPERM:
            return fail(ErrorCode::refused, where + " may not be opened by this user",
                        "choose a port from 1024 up, or let systemd open it (socket activation)");
        case EADDRNOTAVAIL:
            return fail(ErrorCode::not_found, fmt::format("{} is not an address of this machine", options.host),
                        "choose one that `ip address` lists, or 0.0.0.0 for all");
        default:
            return fail(ErrorCode::io, fmt::format("{} cannot be opened: {}", where, std::strerror(error)),
                        "check the network");
    }
}

Result<common::UniqueFd> listen_on(const ServerOptions& options) {
    addrinfo hints{};
    hints.ai_flags = AI_PASSIVE | AI_NUMERICHOST | AI_NUMERICSERV;
    hints.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    const std::string host = options.host == "localhost" ? "127.0.0.1" : options.host;
    if (::getaddrinfo(host.c_str(), std::to_string(options.port).c_str(), &hints, &found) != 0) {
        return fail(ErrorCode::invalid_argument,
                    fmt::format("\"{}\" is not a network address to listen on", options.host),
                    "give an IPv4 or IPv6 address of this machine, or 0.0.0.0 for all");
    }
    common::UniqueFd fd(::socket(found->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    set_option(fd.get(), SOL_SOCKET, SO_REUSEADDR, 1);
    const bool good =
        fd.get() >= 0 && ::bind(fd.get(), found->ai_addr, found->ai_addrlen) == 0 && ::listen(fd.get(), kBacklog) == 0;
    const int error = errno;
    ::freeaddrinfo(found);
    if (!good) return listen_error(options, error);
    return fd;
}

}  // namespace

struct Server::Impl {
    struct Connection {
        common::UniqueFd fd;
        std::string peer;
        bool may_write = false;
        FramerTcp framer;
        std::array<std::uint8_t, kOutputSize> output;
        std::size_t filled = 0, sent = 0;  // output[sent, filled) is not sent yet
        std::uint64_t replies_waiting = 0, requests_done = 0;
        hal::TimePoint last_used;
    };

    hal::EventLoop& loop;
    RegisterModel& model;
    ServerOptions options;
    common::UniqueFd listener;
    hal::EventLoop::WatchId listener_watch = hal::EventLoop::WatchId::none;
    common::UniqueFd ready;  // an epoll of all connections: one watch on the loop for all of them
    hal::EventLoop::WatchId ready_watch = hal::EventLoop::WatchId::none;
    hal::EventLoop::TimerId pause = hal::EventLoop::TimerId::none;
    std::vector<std::unique_ptr<Connection>> connections;
    std::vector<std::unique_ptr<Connection>> closed;  // destroyed in the next turn: pending events may point to them
    ServerStatistics statistics;

    Impl(hal::EventLoop& l, RegisterModel& m, ServerOptions o, common::UniqueFd fd)
        : loop(l), model(m), options(std::move(o)), listener(std::move(fd)), ready(::epoll_create1(EPOLL_CLOEXEC)) {
        connections.reserve(options.max_connections);
    }
    ~Impl() {
        loop.unwatch(listener_watch);
        loop.unwatch(ready_watch);
        loop.cancel(pause);
    }
    Impl(const Impl&) = delete;
    Impl& operator=(const Impl&) = delete;

    Result<void> start() {
        if (ready.get() < 0) {
            return fail(ErrorCode::io,
                        fmt::format("the Modbus server cannot watch its connections: {}", std::strerror(errno)),
                        "raise the limit of open files (ulimit -n)");
        }
        auto watch = loop.watch(ready.get(), hal::EventLoop::Readiness::readable, [this] { on_ready(); });
        if (!watch) return tl::unexpected(watch.error());
        ready_watch = *watch;
        return listen();
    }

    Result<void> listen() {
        return assign(listener_watch,
                      loop.watch(listener.get(), hal::EventLoop::Readiness::readable, [this] { on_newcomers(); }));
    }

    // -- new connections

    void on_newcomers() {
        closed.clear();
        for (int k = 0; k < kAcceptsPerTurn; ++k) {
            sockaddr_storage address{};
            socklen_t length = sizeof address;
            common::UniqueFd fd(::accept4(listener.get(), reinterpret_cast<sockaddr*>(&address), &length,
                                          SOCK_NONBLOCK | SOCK_CLOEXEC));
            if (fd.get() < 0) {
                if (errno == ECONNABORTED || errno == EINTR) continue;
                // Without descriptors accept4() fails even if no client waits; only the first call of a turn follows a
                // readable listener.
                const bool without = errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM;
                if (without && k == 0) make_room_for_descriptors();
                return;
            }
            const Access access = access_of(reinterpret_cast<const sockaddr&>(address), options.access);
            if (access == Access::none) {
                ++statistics.refused;
                continue;
            }
            ++statistics.accepted;
            if (connections.size() >= options.max_connections) evict();
            welcome(std::move(fd), address_of(address, length), options.may_write && access == Access::read_write);
        }
    }

    void welcome(common::UniqueFd fd, std::string peer, bool may_write) {
        set_option(fd.get(), IPPROTO_TCP, TCP_NODELAY, 1);
        // A dead peer is detected after 30 + 3 * 10 seconds.
        set_option(fd.get(), SOL_SOCKET, SO_KEEPALIVE, 1);
        set_option(fd.get(), IPPROTO_TCP, TCP_KEEPIDLE, 30);
        set_option(fd.get(), IPPROTO_TCP, TCP_KEEPINTVL, 10);
        set_option(fd.get(), IPPROTO_TCP, TCP_KEEPCNT, 3);
        auto connection = std::make_unique<Connection>();
        connection->fd = std::move(fd);
        connection->peer = std::move(peer);
        connection->may_write = may_write;
        connection->last_used = loop.now();
        Connection& c = *connection;
        connections.push_back(std::move(connection));
        wait_for(c, EPOLL_CTL_ADD, EPOLLIN);
    }

    void evict() {
        const auto rank = [now = loop.now()](const std::unique_ptr<Connection>& c) {
            int tier = c->requests_done == 0 ? 0 : c->requests_done < kEstablished ? 1 : 2;
            if (tier == 2 && now - c->last_used > kEstablishedIdle) tier = 1;
            return std::tuple(tier, c->last_used);
        };
        const auto victim = std::min_element(connections.begin(), connections.end(),
                                             [&](const auto& a, const auto& b) { return rank(a) < rank(b); });
        if (victim == connections.end()) return;
        ++statistics.evicted;
        close(**victim);
    }

    // The process has no descriptors left: close a connection, or try again later.
    void make_room_for_descriptors() {
        if (!connections.empty()) return evict();
        loop.unwatch(std::exchange(listener_watch, hal::EventLoop::WatchId::none));
        pause = loop.call_after(kPauseWithoutDescriptors, [this] {
            pause = hal::EventLoop::TimerId::none;
            if (!listen()) make_room_for_descriptors();
        });
    }

    void set_access(std::vector<AccessRule> access) {
        closed.clear();
        options.access = std::move(access);
        for (std::size_t k = connections.size(); k-- > 0;) {
            Connection& c = *connections[k];
            sockaddr_storage address{};
            socklen_t length = sizeof address;
            const bool known = ::getpeername(c.fd.get(), reinterpret_cast<sockaddr*>(&address), &length) == 0;
            const Access allowed =
                known ? access_of(reinterpret_cast<const sockaddr&>(address), options.access) : Access::none;
            c.may_write = options.may_write && allowed == Access::read_write;
            if (allowed == Access::none) close(c);
        }
    }

    // -- one connection

    void on_ready() {
        closed.clear();
        std::array<epoll_event, kServedPerTurn> events;
        const int count = ::epoll_wait(ready.get(), events.data(), kServedPerTurn, 0);
        for (int k = 0; k < count; ++k) {
            Connection& c = *static_cast<Connection*>(events[static_cast<std::size_t>(k)].data.ptr);
            if (c.fd.get() < 0) continue;  // closed in this turn
            if (c.sent < c.filled) on_writable(c);
            else on_readable(c);
        }
    }

    void wait_for(Connection& c, int operation, std::uint32_t what) {
        epoll_event wanted{};
        wanted.events = what;
        wanted.data.ptr = &c;
        if (::epoll_ctl(ready.get(), operation, c.fd.get(), &wanted) != 0) close(c);
    }

    void close(Connection& c) {
        c.fd.reset();  // removes it from the epoll, too
        const auto at =
            std::find_if(connections.begin(), connections.end(), [&](const auto& p) { return p.get() == &c; });
        closed.push_back(std::move(*at));
        connections.erase(at);
    }

    void on_readable(Connection& c) {
        std::array<std::uint8_t, kInputSize> input;
        const ssize_t count = ::recv(c.fd.get(), input.data(), input.size(), MSG_DONTWAIT);
        if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)) return;
        if (count <= 0) return close(c);
        std::span<const std::uint8_t> bytes(input.data(), static_cast<std::size_t>(count));
        while (const auto request = c.framer.take(bytes)) answer(c, *request);
        if (c.framer.broken()) {
            ++statistics.broken;
            return close(c);
        }
        if (!send_replies(c)) return close(c);
        if (c.sent < c.filled) wait_for(c, EPOLL_CTL_MOD, EPOLLOUT);
    }

    void on_writable(Connection& c) {
        if (!send_replies(c)) return close(c);
        if (c.sent == c.filled) wait_for(c, EPOLL_CTL_MOD, EPOLLIN);
    }

    void answer(Connection& c, const Request& request) {
        const auto frame = std::span(c.output).subspan(c.filled);
        const Origin origin{.peer = c.peer, .may_write = c.may_write};
        const std::size_t size = dispatch(model, origin, request.pdu, frame.subspan(kMbapSize).first<kMaxPdu>());
        write_mbap(request, size, frame);
        c.filled += kMbapSize + size;
        ++c.replies_waiting;
        ++statistics.requests;
        if ((frame[kMbapSize] & 0x80U) != 0) ++statistics.exceptions;
    }

    // False: the connection is lost. Bytes that do not fit into the socket's buffer stay in `output`.
    bool send_replies(Connection& c) {
        while (c.sent < c.filled) {
            const ssize_t count =
                ::send(c.fd.get(), c.output.data() + c.sent, c.filled - c.sent, MSG_DONTWAIT | MSG_NOSIGNAL);
            if (count < 0 && errno == EINTR) continue;
            if (count < 0) return errno == EAGAIN || errno == EWOULDBLOCK;
            c.sent += static_cast<std::size_t>(count);
        }
        c.sent = c.filled = 0;
        c.requests_done += std::exchange(c.replies_waiting, 0);
        if (c.requests_done > 0) c.last_used = loop.now();
        return true;
    }
};

Server::Server(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Server::~Server() = default;

Result<std::unique_ptr<Server>> Server::open(hal::EventLoop& loop, RegisterModel& model, ServerOptions options) {
    auto fd = listen_on(options);
    if (!fd) return tl::unexpected(fd.error());
    return adopt(loop, model, fd->release(), std::move(options));
}

Result<std::unique_ptr<Server>> Server::adopt(hal::EventLoop& loop, RegisterModel& model, int listening_fd,
                                              ServerOptions options) {
    common::UniqueFd fd(listening_fd);
    int listening = 0;
    socklen_t length = sizeof listening;
    if (::getsockopt(fd.get(), SOL_SOCKET, SO_ACCEPTCONN, &listening, &length) != 0 || listening == 0) {
        return fail(ErrorCode::invalid_argument, fmt::format("descriptor {} is not a listening socket", listening_fd),
                    "check the socket unit: ListenStream=, Accept=no");
    }
    if (options.max_connections == 0) {
        return fail(ErrorCode::invalid_argument, "a Modbus server needs at least one connection",
                    "set max_connections above 0");
    }
    ::fcntl(fd.get(), F_SETFL, ::fcntl(fd.get(), F_GETFL) | O_NONBLOCK);
    ::fcntl(fd.get(), F_SETFD, FD_CLOEXEC);
    auto impl = std::make_unique<Impl>(loop, model, std::move(options), std::move(fd));
    if (auto started = impl->start(); !started) return tl::unexpected(started.error());
    return std::unique_ptr<Server>(new Server(std::move(impl)));
}

void Server::set_access(std::vector<AccessRule> access) { impl_->set_access(std::move(access)); }

std::uint16_t Server::port() const {
    sockaddr_storage address{};
    socklen_t length = sizeof address;
    if (::getsockname(impl_->listener.get(), reinterpret_cast<sockaddr*>(&address), &length) != 0) return 0;
    return ntohs(address.ss_family == AF_INET6 ? reinterpret_cast<const sockaddr_in6&>(address).sin6_port
                                               : reinterpret_cast<const sockaddr_in&>(address).sin_port);
}

ServerStatistics Server::statistics() const {
    ServerStatistics now = impl_->statistics;
    now.connections = impl_->connections.size();
    return now;
}

}  // namespace hord::firmware::modbus
