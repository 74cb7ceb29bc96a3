#include "hal_sim/coil_module/coil_module.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>
#include <string_view>

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sched.h>
#include <sys/eventfd.h>
#include <sys/socket.h>

namespace hord::sim {
namespace {

constexpr std::size_t kMbapBytes = 7, kMaxAdu = 260;  // the header with its unit; header and request together
constexpr std::uint8_t kReadCoils = 1, kWriteCoil = 5, kIdentify = 43;
constexpr std::uint8_t kIllegalFunction = 1, kIllegalAddress = 2, kIllegalValue = 3;

}  // namespace

Result<std::unique_ptr<CoilModule>> CoilModule::open(const hal::Clock& clock, int realtime) {
    std::unique_ptr<CoilModule> module(new CoilModule(clock));
    module->stop_.reset(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
    if (!module->stop_) return fail(ErrorCode::io, "the coil module cannot be made", "check the limit of open files");
    if (auto listening = module->listen(); !listening) return tl::unexpected(listening.error());
    module->thread_ = std::thread([raw = module.get(), realtime] {
        sched_param param{};
        param.sched_priority = realtime;
        if (realtime > 0) ::sched_setscheduler(0, SCHED_FIFO, &param);
        raw->serve();
    });
    return module;
}

CoilModule::~CoilModule() {
    if (!thread_.joinable()) return;
    eventfd_write(stop_.get(), 1);
    thread_.join();
}

Result<void> CoilModule::listen() {
    listener_.reset(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    auto* const name = reinterpret_cast<sockaddr*>(&address);
    if (bind(listener_.get(), name, size) != 0 || ::listen(listener_.get(), 8) != 0 ||
        getsockname(listener_.get(), name, &size) != 0) {
        return fail(ErrorCode::io, std::string("the coil module cannot listen on 127.0.0.1: ") + std::strerror(errno),
                    "check the limit of open files");
    }
    port_ = ntohs(address.sin_port);
    return {};
}

void CoilModule::serve() {
    for (;;) {
        std::vector<pollfd> fds = {{stop_.get(), POLLIN, 0}, {listener_.get(), POLLIN, 0}};
        for (const auto& client : clients_) fds.push_back({client.get(), POLLIN, 0});
        if (poll(fds.data(), fds.size(), -1) < 0 && errno != EINTR) break;
        if (fds[0].revents != 0) break;
        if ((fds[1].revents & POLLIN) != 0) accept_one();
        for (std::size_t k = 2; k < fds.size(); ++k) {
            if (fds[k].revents == 0 || answer(fds[k].fd)) continue;
            std::erase_if(clients_, [&](const common::UniqueFd& client) { return client.get() == fds[k].fd; });
        }
    }
    clients_.clear();
    for (std::size_t coil = 0; coil < coils_.size(); ++coil) move(coil, false);
}

void CoilModule::accept_one() {
    common::UniqueFd client(accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC));
    if (!client) return;
    const int yes = 1;
    setsockopt(client.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    clients_.push_back(std::move(client));
}

bool CoilModule::answer(int client) {
    std::array<std::uint8_t, kMaxAdu> frame{};
    const auto receive = [&](std::size_t at, std::size_t count) {
        return recv(client, frame.data() + at, count, MSG_WAITALL) == static_cast<ssize_t>(count);
    };
    if (!receive(0, kMbapBytes)) return false;
    const std::size_t size = static_cast<std::size_t>(frame[4] << 8 | frame[5]) - 1;  // the length counts the unit
    if (size < 1 || size > kMaxAdu - kMbapBytes || !receive(kMbapBytes, size)) return false;
    const Bytes reply = reply_to({frame.data() + kMbapBytes, size});
    frame[4] = 0, frame[5] = static_cast<std::uint8_t>(reply.size() + 1);
    std::copy(reply.begin(), reply.end(), frame.begin() + kMbapBytes);
    const std::size_t all = kMbapBytes + reply.size();
    return send(client, frame.data(), all, MSG_NOSIGNAL) == static_cast<ssize_t>(all);
}

CoilModule::Bytes CoilModule::reply_to(std::span<const std::uint8_t> request) {
    const std::uint8_t function = request[0];
    const auto refuse = [&](std::uint8_t why) { return Bytes{static_cast<std::uint8_t>(function | 0x80), why}; };
    if (function == kIdentify) {  // Read Device Identification, basic, as a stream
        if (request.size() != 4 || request[1] != 14 || request[2] != 1) return refuse(kIllegalValue);
        Bytes reply{kIdentify, 14, 1, 1, 0, 0, 3};
        std::uint8_t number = 0;
        for (const std::string_view text : {"HORD", "coil module", "1.0"}) {
            reply.push_back(number++);
            reply.push_back(static_cast<std::uint8_t>(text.size()));
            reply.insert(reply.end(), text.begin(), text.end());
        }
        return reply;
    }
    if (function != kReadCoils && function != kWriteCoil) return refuse(kIllegalFunction);
    if (request.size() != 5) return refuse(kIllegalValue);
    const auto address = static_cast<std::size_t>(request[1] << 8 | request[2]);
    const int value = request[3] << 8 | request[4];  // how many to read, or what to write
    if (function == kWriteCoil) {
        if (value != 0 && value != 0xFF00) return refuse(kIllegalValue);
        if (address >= coils_.size()) return refuse(kIllegalAddress);
        move(address, value != 0);
        return {request.begin(), request.end()};
    }
    if (value < 1) return refuse(kIllegalValue);
    const auto count = static_cast<std::size_t>(value);
    if (address + count > coils_.size()) return refuse(kIllegalAddress);
    Bytes reply{kReadCoils, static_cast<std::uint8_t>((count + 7) / 8)};
    reply.resize(2U + reply[1]);
    for (std::size_t k = 0; k < count; ++k)
        reply[2 + k / 8] |= static_cast<std::uint8_t>((coils_[address + k] ? 1U : 0U) << k % 8);
    return reply;
}

void CoilModule::move(std::size_t coil, bool on) {
    if (std::exchange(coils_[coil], on) != on && on_coil_) on_coil_(static_cast<int>(coil), on, clock_.now());
}

}  // namespace hord::sim
