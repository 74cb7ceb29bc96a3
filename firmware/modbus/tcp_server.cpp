#include "firmware/modbus/tcp_server.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <map>
#include <tuple>
#include <utility>
#include <vector>

#include <fcntl.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/assign.h"
#include "common/tcp_listener.h"
#include "common/unique_fd.h"

namespace hord::firmware::modbus {
namespace {

using namespace std::chrono_literals;

constexpr int kAcceptsPerTurn = 8;
constexpr int kServedPerTurn = 32;         // connections served in one callback of the loop
constexpr std::uint64_t kEstablished = 8;  // completed requests of an established client
constexpr auto kEstablishedIdle = 10s;     // longest silence of one
constexpr std::size_t kCrowd = 4;          // an address that holds more than 1/kCrowd of all connections is crowded
constexpr auto kPauseWithoutDescriptors = 100ms;

// One turn reads at most kInputSize bytes, and only when every earlier reply has been sent. The shortest request with a
// reply of full size has 11 bytes: at most 264 / 11 + 1 = 25 replies of at most 260 bytes, 6500 bytes.
constexpr std::size_t kInputSize = 264;
constexpr std::size_t kOutputSize = 8192;
static_assert((kInputSize / 11 + 1) * kMaxTcpFrame <= kOutputSize);

bool writes(std::uint8_t function) {
    constexpr std::array<std::uint8_t, 6> kWriting{5, 6, 15, 16, 22, 23};
    return std::ranges::find(kWriting, function) != kWriting.end();
}

void set_option(int fd, int level, int option, int value) { ::setsockopt(fd, level, option, &value, sizeof value); }

}  // namespace

struct Server::Impl {
    struct Connection {
        common::UniqueFd fd;
        std::string peer;
        bool may_write = false, has_written = false;  // may, has: completed a writing request
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
            const bool may_write = options.may_write && access == Access::read_write;
            std::string peer = common::address_text(address, length);
            if (connections.size() >= options.max_connections && !evict(may_write, peer)) {
                ++statistics.refused;
                continue;
            }
            ++statistics.accepted;
            welcome(std::move(fd), std::move(peer), may_write);
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

    // Closes a connection for a newcomer. False: the newcomer may only read, and all connections may write.
    bool evict(bool for_writer, std::string_view newcomer) {
        std::map<std::string_view, std::size_t> held{{common::host_of(newcomer), 1}};
        for (const auto& c : connections) ++held[common::host_of(c->peer)];
        const auto rank = [&, now = loop.now()](const Connection& c) {
            int tier = c.requests_done == 0 ? 0 : c.requests_done < kEstablished ? 1 : 2;
            if (tier == 2 && now - c.last_used > kEstablishedIdle) tier = 1;
            const bool crowded = kCrowd * held[common::host_of(c.peer)] > options.max_connections;
            return std::tuple(c.has_written, !crowded, tier, c.last_used);
        };
        Connection* victim = nullptr;
        for (const auto& c : connections) {
            if ((for_writer || !c->may_write) && (victim == nullptr || rank(*c) < rank(*victim))) victim = c.get();
        }
        if (victim == nullptr) return false;
        ++statistics.evicted;
        close(*victim);
        return true;
    }

    // The process has no descriptors left: close a connection, or try again later.
    void make_room_for_descriptors() {
        if (evict(false, {}) || evict(true, {})) return;
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
        // Closing alone leaves it in the epoll while a forked child holds the descriptor.
        ::epoll_ctl(ready.get(), EPOLL_CTL_DEL, c.fd.get(), nullptr);
        c.fd.reset();
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
        else if (writes(frame[kMbapSize])) c.has_written = true;
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
    auto fd = common::listen_on("Modbus", options.host, options.port);
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

std::string Server::address() const { return common::local_address(impl_->listener.get()); }
std::uint16_t Server::port() const { return common::local_port(impl_->listener.get()); }

ServerStatistics Server::statistics() const {
    ServerStatistics now = impl_->statistics;
    now.connections = impl_->connections.size();
    return now;
}

}  // namespace hord::firmware::modbus
