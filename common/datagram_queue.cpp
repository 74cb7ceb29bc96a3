#include "common/datagram_queue.h"

#include <cerrno>
#include <cstddef>
#include <cstring>
#include <thread>
#include <utility>

#include <sys/socket.h>
#include <sys/un.h>

namespace hord::common {

// Every datagram names the address: a reader that starts again has a new socket there.
int DatagramQueue::send_now(std::string_view datagram) {
    sockaddr_un to{};
    to.sun_family = AF_UNIX;
    if (address_.empty() || address_.size() >= sizeof to.sun_path) return EINVAL;
    std::memcpy(to.sun_path, address_.data(), address_.size());
    if (to.sun_path[0] == '@') to.sun_path[0] = '\0';
    if (!socket_) socket_ = UniqueFd(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + address_.size());
    const ssize_t sent = ::sendto(socket_.get(), datagram.data(), datagram.size(), MSG_DONTWAIT | MSG_NOSIGNAL,
                                  reinterpret_cast<const sockaddr*>(&to), length);
    return sent < 0 ? errno : 0;
}

void DatagramQueue::flush() {
    while (!waiting_.empty()) {
        const int error = send_now(waiting_.front());
        if (error != 0 && error != EMSGSIZE) return;
        if (error != 0) ++lost_;
        waiting_.pop_front();
    }
}

void DatagramQueue::send(std::string datagram) {
    flush();
    if (waiting_.size() >= kMaxWaiting) {
        ++lost_;
        return;
    }
    waiting_.push_back(std::move(datagram));
    if (waiting_.size() == 1) flush();
}

void DatagramQueue::send_newest(std::string datagram) {
    flush();
    const auto name = [](std::string_view text) { return text.substr(0, text.find('=')); };
    std::erase_if(waiting_, [&](const std::string& kept) { return name(kept) == name(datagram); });
    waiting_.push_back(std::move(datagram));
    if (waiting_.size() == 1) flush();
}

void DatagramQueue::finish(std::chrono::milliseconds patience) {
    const auto until = std::chrono::steady_clock::now() + patience;
    for (flush(); !waiting_.empty() && std::chrono::steady_clock::now() < until; flush())
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
}

}  // namespace hord::common
