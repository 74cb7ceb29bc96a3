// Datagrams to a service of systemd (the journal, the service manager). Sending never waits: what the reader does not
// take at once is kept here, in order, until it does.
#pragma once

#include <chrono>
#include <cstddef>
#include <deque>
#include <string>
#include <string_view>

#include "common/unique_fd.h"

namespace hord::common {

// Not thread-safe.
class DatagramQueue {
  public:
    static constexpr std::size_t kMaxWaiting = 1000;

    // `address`: of the reader's socket, as a path; "@name": an abstract one.
    explicit DatagramQueue(std::string_view address) : address_(address) {}

    // Lost, if kMaxWaiting are kept, or if it is larger than the kernel sends.
    void send(std::string datagram);
    // For a state, of which only the newest counts ("STATUS=..."): instead of a kept one with the same name before its
    // first '=', and behind all others. Never lost, because names are few; as send(), if it is too large.
    void send_newest(std::string datagram);
    // Sends of the kept ones what the reader takes now.
    void flush();
    // For the end of a program: flushes again and again, at most so long.
    void finish(std::chrono::milliseconds patience);

    [[nodiscard]] std::size_t waiting() const { return waiting_.size(); }
    [[nodiscard]] std::size_t lost() const { return lost_; }
    void forget_lost() { lost_ = 0; }

  private:
    [[nodiscard]] int send_now(std::string_view datagram);  // 0 or the errno

    std::string address_;
    UniqueFd socket_;
    std::deque<std::string> waiting_;
    std::size_t lost_ = 0;
};

}  // namespace hord::common
