// The register server under attack, and against libmodbus's own server. Prints tables as Markdown:
// docs/results/modbus.md.
//
//   bench_modbus [SECONDS]     of each measurement, 3 unless given
//
// The comparison measures the cost of a request: sched_setaffinity binds server and clients to one core, and in a
// second row to two. Under attack they may use all cores: a legitimate client polls every 10 ms; its longest wait
// counts, and no request may fail.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <modbus/modbus.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sched.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "firmware/modbus/tcp_server.h"
#include "firmware/plc/register_server_model.h"

namespace {

using namespace hord;
using namespace hord::firmware;
using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;
using Bytes = std::vector<std::uint8_t>;

const Bytes kRead40{0, 1, 0, 0, 0, 6, 1, 3, 0, 100, 0, 40};  // reads the whole block STATUS
constexpr std::size_t kReply40 = 9 + 80;

// A TCP client that sends given bytes unchanged.
class Peer {
  public:
    explicit Peer(std::uint16_t port) : fd_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
        const int on = 1;
        ::setsockopt(fd_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(port);
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        good_ = ::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    }
    Peer(Peer&& other) noexcept : fd_(std::exchange(other.fd_, -1)), good_(other.good_) {}
    Peer& operator=(Peer&&) = delete;
    ~Peer() {
        if (fd_ >= 0) ::close(fd_);
    }
    [[nodiscard]] bool good() const { return good_; }
    [[nodiscard]] int fd() const { return fd_; }
    void send(const Bytes& bytes) const {
        [[maybe_unused]] const auto sent = ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    }
    // True if the whole reply to kRead40 arrives within two seconds.
    [[nodiscard]] bool reply() const {
        std::array<std::uint8_t, kReply40> bytes;
        std::size_t filled = 0;
        while (filled < bytes.size()) {
            pollfd ready{fd_, POLLIN, 0};
            if (::poll(&ready, 1, 2000) <= 0) return false;
            const auto got = ::recv(fd_, bytes.data() + filled, bytes.size() - filled, 0);
            if (got <= 0) return false;
            filled += static_cast<std::size_t>(got);
        }
        return bytes[7] == 3 && bytes[8] == 80;
    }

  private:
    int fd_;
    bool good_ = false;
};

// The station's server on the service's event loop, on a thread of its own.
class Ours {
  public:
    Ours() {
        loop_ = std::move(*SdEventLoop::open());
        server_ = std::move(*modbus::Server::open(*loop_, image_, {.host = "127.0.0.1", .port = 0, .access = {}}));
        thread_ = std::thread([this] { (void)loop_->run(); });
    }
    ~Ours() {
        loop_->request_stop();
        thread_.join();
    }
    Ours(const Ours&) = delete;
    Ours& operator=(const Ours&) = delete;
    [[nodiscard]] std::uint16_t port() const { return server_->port(); }

  private:
    std::unique_ptr<SdEventLoop> loop_;
    RegisterServerModel image_{StationIdentity{.firmware = "bench", .serial = "bench", .boot_id = 1}};
    std::unique_ptr<modbus::Server> server_;
    std::thread thread_;
};

// libmodbus's server as in its manual: one client; receive, reply.
class Theirs {
  public:
    Theirs() : context_(modbus_new_tcp("127.0.0.1", 0)), map_(modbus_mapping_new(0, 0, 9000, 0)) {
        listener_ = modbus_tcp_listen(context_, 1);
        sockaddr_in address{};
        socklen_t size = sizeof address;
        ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
        port_ = ntohs(address.sin_port);
        thread_ = std::thread([this] {
            if (modbus_tcp_accept(context_, &listener_) < 0) return;
            std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> request;
            while (true) {
                const int received = modbus_receive(context_, request.data());
                if (received < 0) return;
                if (received > 0) modbus_reply(context_, request.data(), received, map_);
            }
        });
    }
    ~Theirs() {
        thread_.join();  // ends when its client disconnects
        modbus_mapping_free(map_);
        modbus_close(context_);
        modbus_free(context_);
        ::close(listener_);
    }
    Theirs(const Theirs&) = delete;
    Theirs& operator=(const Theirs&) = delete;
    [[nodiscard]] std::uint16_t port() const { return port_; }

  private:
    modbus_t* context_;
    modbus_mapping_t* map_;
    int listener_ = -1;
    std::uint16_t port_ = 0;
    std::thread thread_;
};

// Requests answered per second. All clients run in one thread; each sends again as soon as it has its reply.
double requests_a_second(std::uint16_t port, int clients, Clock::duration time) {
    const int epoll = ::epoll_create1(EPOLL_CLOEXEC);
    std::vector<Peer> peers;
    std::vector<std::size_t> filled(static_cast<std::size_t>(clients));
    for (int k = 0; k < clients; ++k) {
        peers.emplace_back(port);
        epoll_event wanted{};
        wanted.events = EPOLLIN;
        wanted.data.u32 = static_cast<std::uint32_t>(k);
        ::epoll_ctl(epoll, EPOLL_CTL_ADD, peers.back().fd(), &wanted);
        peers.back().send(kRead40);
    }
    std::uint64_t answered = 0;
    const auto begun = Clock::now();
    std::array<std::uint8_t, kReply40> bytes;
    while (Clock::now() - begun < time) {
        std::array<epoll_event, 64> events;
        const int ready = ::epoll_wait(epoll, events.data(), static_cast<int>(events.size()), 100);
        for (int e = 0; e < ready; ++e) {
            const auto k = events[static_cast<std::size_t>(e)].data.u32;
            const auto got = ::recv(peers[k].fd(), bytes.data(), kReply40 - filled[k], MSG_DONTWAIT);
            if (got <= 0) continue;
            filled[k] += static_cast<std::size_t>(got);
            if (filled[k] < kReply40) continue;
            filled[k] = 0;
            ++answered;
            peers[k].send(kRead40);
        }
    }
    ::close(epoll);
    return static_cast<double>(answered) / std::chrono::duration<double>(Clock::now() - begun).count();
}

struct Waits {
    std::size_t requests = 0, errors = 0;
    double p50_ms = 0, p99_ms = 0, longest_ms = 0;
};

// Polls every 10 ms on one connection, or at once if the last reply took longer. A wait counts from the sending.
Waits poll_for(const Peer& client, Clock::duration time) {
    std::vector<double> waits;
    Waits result;
    const auto begun = Clock::now();
    for (auto due = begun; due - begun < time; due += 10ms) {
        std::this_thread::sleep_until(due);
        const auto asked = Clock::now();
        client.send(kRead40);
        ++result.requests;
        if (!client.reply()) {
            ++result.errors;
            break;
        }
        waits.push_back(std::chrono::duration<double, std::milli>(Clock::now() - asked).count());
        due = std::max(due, Clock::now() - 10ms);
    }
    std::sort(waits.begin(), waits.end());
    if (waits.empty()) return result;
    result.p50_ms = waits[waits.size() / 2];
    result.p99_ms = waits[waits.size() * 99 / 100];
    result.longest_ms = waits.back();
    return result;
}

// An attack, repeated until `over` is set.
struct Attack {
    const char* name;
    std::function<void(std::uint16_t port, const std::atomic<bool>& over)> run;
};

void hold(const std::atomic<bool>& over) {
    while (!over) std::this_thread::sleep_for(10ms);
}

std::vector<Attack> attacks() {
    const auto flood = [](Bytes frame) {
        return [frame = std::move(frame)](std::uint16_t port, const std::atomic<bool>& over) {
            while (!over) {
                Peer peer(port);
                std::array<std::uint8_t, 512> sink;
                for (int k = 0; k < 50 && !over; ++k) {
                    peer.send(frame);
                    pollfd ready{peer.fd(), POLLIN, 0};
                    if (::poll(&ready, 1, 20) > 0 && ::recv(peer.fd(), sink.data(), sink.size(), MSG_DONTWAIT) <= 0)
                        break;
                }
            }
        };
    };
    return {
        {"none", [](std::uint16_t, const std::atomic<bool>& over) { hold(over); }},
        {"partial frames held, 31 connections",
         [](std::uint16_t port, const std::atomic<bool>& over) {
             std::vector<Peer> peers;
             for (std::ptrdiff_t k = 0; k < 31; ++k)
                 peers.emplace_back(port).send(Bytes(kRead40.begin(), kRead40.begin() + 1 + k % 11));
             hold(over);
         }},
        {"one byte every 0.4 s",
         [](std::uint16_t port, const std::atomic<bool>& over) {
             const Peer peer(port);
             for (std::size_t k = 0; !over; ++k) {
                 peer.send({kRead40[k % kRead40.size()]});
                 for (int wait = 0; wait < 40 && !over; ++wait) std::this_thread::sleep_for(10ms);
             }
         }},
        {"a client that asks and never reads",
         [](std::uint16_t port, const std::atomic<bool>& over) {
             const Peer peer(port);
             while (!over) {
                 for (int k = 0; k < 100; ++k) peer.send(kRead40);
                 std::this_thread::sleep_for(1ms);
             }
         }},
        {"garbage",
         [](std::uint16_t port, const std::atomic<bool>& over) {
             std::mt19937 random(1);
             while (!over) {
                 const Peer peer(port);
                 Bytes noise(200);
                 for (auto& byte : noise) byte = static_cast<std::uint8_t>(random());
                 peer.send(noise);
                 std::this_thread::sleep_for(1ms);
             }
         }},
        {"bad function", flood({0, 1, 0, 0, 0, 6, 1, 99, 0, 0, 0, 1})},
        {"bad quantity", flood({0, 1, 0, 0, 0, 6, 1, 3, 0, 0, 0xFF, 0xFF})},
        {"device identification (43/14)", flood({0, 1, 0, 0, 0, 5, 1, 43, 14, 1, 0})},
        {"1,500 connections, each asks once",
         [](std::uint16_t port, const std::atomic<bool>& over) {
             std::vector<Peer> peers;
             while (!over) {
                 if (peers.size() == 1500) peers.clear();
                 peers.emplace_back(port).send(kRead40);
             }
         }},
    };
}

// Binds this thread, and threads that it starts later, to `cores`.
void run_on(const std::vector<std::size_t>& cores) {
    cpu_set_t set;
    CPU_ZERO(&set);
    for (const std::size_t core : cores) CPU_SET(core, &set);
    ::sched_setaffinity(0, sizeof set, &set);
}

// One row of the table. The server and its clients may have one core each, or share one.
void compare(const char* what, std::size_t server_core, std::size_t client_core, Clock::duration time) {
    constexpr int kRounds = 5;
    std::vector<double> theirs, ours, ratios;
    for (int round = 0; round < kRounds; ++round) {  // alternating: load affects both servers alike
        {
            run_on({server_core});
            const Theirs server;
            run_on({client_core});
            theirs.push_back(requests_a_second(server.port(), 1, time));
        }
        run_on({server_core});
        const Ours server;
        run_on({client_core});
        ours.push_back(requests_a_second(server.port(), 32, time));
        ratios.push_back(ours.back() / theirs.back());
    }
    const auto median = [](std::vector<double>& values) {
        std::sort(values.begin(), values.end());
        return values[values.size() / 2];
    };
    fmt::print("| {} | {:.0f} | {:.0f} | {:.2f}x |\n", what, median(theirs), median(ours), median(ratios));
}

void compare(Clock::duration time) {
    cpu_set_t all;
    ::sched_getaffinity(0, sizeof all, &all);
    std::vector<std::size_t> cores;
    for (std::size_t core = 0; core < CPU_SETSIZE; ++core) {
        if (CPU_ISSET(core, &all)) cores.push_back(core);
    }
    fmt::print(
        "| the server has | libmodbus {}.{}.{}, one client, requests a second | this station's, 32 clients | ratio "
        "|\n|---|---|---|---|\n",
        LIBMODBUS_VERSION_MAJOR, LIBMODBUS_VERSION_MINOR, LIBMODBUS_VERSION_MICRO);
    if (cores.size() > 1) compare("a core of its own", cores[0], cores[1], time);
    compare("a core that its clients share", cores[0], cores[0], time);
    fmt::print("\nMedians of five rounds, in turn.\n\n");
    run_on(cores);
}

void under_attack(Clock::duration time) {
    rlimit files{};
    ::getrlimit(RLIMIT_NOFILE, &files);
    files.rlim_cur = std::min<rlim_t>(files.rlim_max, 8192);
    ::setrlimit(RLIMIT_NOFILE, &files);
    fmt::print("| attack | requests | errors | wait p50, ms | p99, ms | longest, ms |\n|---|---|---|---|---|---|\n");
    for (const Attack& attack : attacks()) {
        const Ours server;
        const Peer legitimate(server.port());
        if (poll_for(legitimate, 200ms).errors > 0) std::exit(1);
        std::atomic<bool> over = false;
        std::thread attacker([&] { attack.run(server.port(), over); });
        const Waits waits = poll_for(legitimate, time);
        over = true;
        attacker.join();
        fmt::print("| {} | {} | {} | {:.2f} | {:.2f} | {:.2f} |\n", attack.name, waits.requests, waits.errors,
                   waits.p50_ms, waits.p99_ms, waits.longest_ms);
        std::fflush(stdout);
    }
}

}  // namespace

int main(int argc, char** argv) {
    const auto time = std::chrono::seconds(argc > 1 ? std::max(1, std::atoi(argv[1])) : 3);
    double load = 0;
    ::getloadavg(&load, 1);
    fmt::print("{} cores, load average {:.1f} at the start.\n\n", std::thread::hardware_concurrency(), load);
    compare(time);
    under_attack(time);
}
