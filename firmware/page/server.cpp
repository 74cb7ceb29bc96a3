// The page's server: its threads, its connections and their limits. Requests: server_requests.cpp.
#include <algorithm>
#include <chrono>
#include <cstring>
#include <mutex>
#include <thread>
#include <utility>

#include <netinet/in.h>
#include <unistd.h>

#include "common/tcp_listener.h"
#include "firmware/page/server_impl.h"

namespace hord::firmware::page {
namespace {

using namespace std::chrono_literals;

constexpr auto kKeepAlive = 3s;  // comment to a viewer without an event
constexpr auto kTick = 200ms;    // of looking at the clients' times
constexpr std::size_t kMaxConnections = 192, kMaxOfOneAddress = 64;
constexpr std::size_t kWorkers = 4;
constexpr std::size_t kConnectionMemory = 16 * 1024;  // head and library's own data

}  // namespace

bool PageServer::Impl::start(unsigned flags, std::vector<MHD_OptionItem> options) {
    const auto as_is = [](void*, MHD_Connection*, char* text) { return std::char_traits<char>::length(text); };
    const auto number = [](std::size_t value) { return static_cast<std::intptr_t>(value); };
    options.insert(
        options.end(),
        {{MHD_OPTION_CONNECTION_LIMIT, number(kMaxConnections + kMaxOfOneAddress), nullptr},  // some are shut down
         {MHD_OPTION_CONNECTION_MEMORY_LIMIT, number(kConnectionMemory), nullptr},
         {MHD_OPTION_STRICT_FOR_CLIENT, 1, nullptr},
         {MHD_OPTION_NOTIFY_CONNECTION, reinterpret_cast<std::intptr_t>(&Impl::on_connection), this},
         {MHD_OPTION_NOTIFY_COMPLETED, reinterpret_cast<std::intptr_t>(&Impl::on_completed), this},
         // Addresses are decoded in read_head(): the library's text ends at a decoded zero.
         {MHD_OPTION_UNESCAPE_CALLBACK, reinterpret_cast<std::intptr_t>(+as_is), nullptr},
         {MHD_OPTION_END, 0, nullptr}});
    daemon = MHD_start_daemon(flags | MHD_USE_EPOLL | MHD_ALLOW_SUSPEND_RESUME, 0, &Impl::on_accept, this,
                              &Impl::on_request, this, MHD_OPTION_ARRAY, options.data(), MHD_OPTION_END);
    return daemon != nullptr;
}

void PageServer::Impl::begin_threads() {
    for (std::size_t k = 0; k < kWorkers; ++k) workers.emplace_back([this] { work(); });
    ticker = std::jthread([this](const std::stop_token& stop) {
        auto keep_alive = Clock::now() + kKeepAlive;
        std::unique_lock lock(mutex);
        while (!wake.wait_for(lock, stop, kTick, [&] { return stop.stop_requested(); })) {
            check_times();
            if (Clock::now() < keep_alive) continue;
            keep_alive += kKeepAlive;
            lock.unlock();
            viewers.keep_alive();
            lock.lock();
        }
    });
}

// The library may not be stopped while a connection is suspended: end the viewers, answer what waits.
PageServer::Impl::~Impl() {
    if (daemon == nullptr) return;
    ticker = {};
    if (!workers.empty()) viewers.end();
    {
        const std::lock_guard lock(mutex);
        ending = true;
    }
    wake.notify_all();
    for (std::thread& worker : workers) worker.join();
    MHD_stop_daemon(daemon);
}

// -- connections

// With the mutex.
void PageServer::Impl::end(Client& client) {
    client.ended = true;
    ::shutdown(client.fd, SHUT_RDWR);
}

// Too many connections, of all or of one address: the oldest without a whole request makes room.
MHD_Result PageServer::Impl::on_accept(void* self, const sockaddr* address, socklen_t length) {
    auto& server = *static_cast<Impl*>(self);
    sockaddr_storage whole{};
    std::memcpy(&whole, address, std::min<std::size_t>(length, sizeof whole));
    const std::string text = common::address_text(whole, length);
    const std::string_view peer = common::host_of(text);
    const std::lock_guard lock(server.mutex);
    const auto open = [&](bool of_peer) {
        return static_cast<std::size_t>(std::ranges::count_if(
            server.clients, [&](const Client& c) { return !c.ended && (!of_peer || c.peer == peer); }));
    };
    const bool crowded = open(true) >= kMaxOfOneAddress;
    if (!crowded && open(false) < kMaxConnections) return MHD_YES;
    server.pages.count_turned_away();
    Client* oldest = nullptr;
    for (Client& c : server.clients) {
        if (!c.ended && c.asking && (!crowded || c.peer == peer) && (oldest == nullptr || c.since < oldest->since))
            oldest = &c;
    }
    if (oldest == nullptr) return MHD_NO;
    end(*oldest);
    return MHD_YES;
}

void PageServer::Impl::on_connection(void* self, MHD_Connection* connection, void** context,
                                     MHD_ConnectionNotificationCode what) {
    auto& server = *static_cast<Impl*>(self);
    const std::lock_guard lock(server.mutex);
    if (what == MHD_CONNECTION_NOTIFY_CLOSED) {
        std::erase_if(server.clients, [&](const Client& c) { return &c == *context; });
        return;
    }
    Client client;
    client.fd = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd;
    sockaddr_storage address{};
    socklen_t length = sizeof address;
    ::getpeername(client.fd, reinterpret_cast<sockaddr*>(&address), &length);
    client.peer = common::host_of(common::address_text(address, length));
    client.since = Clock::now();
    client.due = client.since + kRequestTimeout;
    server.clients.push_back(std::move(client));
    *context = &server.clients.back();
}

// With the mutex.
void PageServer::Impl::check_times() {
    const auto now = Clock::now();
    for (Client& client : clients) {
        if (!client.ended && now > client.due) end(client);
    }
}

PageServer::PageServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PageServer::~PageServer() = default;

Result<std::unique_ptr<PageServer>> PageServer::open(const PageConfig& config, Pages& pages, Viewers& viewers) {
    auto listener = common::listen_on("the page's", config.host, config.port);
    if (!listener) return tl::unexpected(listener.error());
    auto impl = std::make_unique<Impl>(pages, viewers);
    impl->address = common::local_address(listener->get());
    impl->begin_threads();
    if (!impl->start(MHD_USE_INTERNAL_POLLING_THREAD | MHD_USE_ITC,
                     {{MHD_OPTION_LISTEN_SOCKET, listener->get(), nullptr}}))
        return fail(ErrorCode::io, "the page's HTTP server cannot be started", "raise the limit of open files");
    (void)listener->release();  // the library closes it
    return std::unique_ptr<PageServer>(new PageServer(std::move(impl)));
}

std::string PageServer::address() const { return impl_->address; }

void serve_connection(Pages& pages, Viewers& viewers, int fd, const std::function<bool()>& turn) {
    PageServer::Impl server(pages, viewers);
    sockaddr_in nowhere{};
    nowhere.sin_family = AF_INET;
    if (!server.start(MHD_USE_NO_LISTEN_SOCKET, {})) {
        ::close(fd);
        return;
    }
    if (MHD_add_connection(server.daemon, fd, reinterpret_cast<const sockaddr*>(&nowhere), sizeof nowhere) != MHD_YES)
        return;
    while (MHD_run_wait(server.daemon, 0) == MHD_YES && !server.clients.empty()) {
        if (turn()) continue;
        ::shutdown(fd, SHUT_RDWR);
        viewers.keep_alive();
    }
}

}  // namespace hord::firmware::page
