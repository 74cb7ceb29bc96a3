#include "tests/drivers/genicam/network_between.h"

#include <atomic>
#include <condition_variable>
#include <cstring>
#include <deque>
#include <map>
#include <mutex>
#include <thread>
#include <vector>

#include <dlfcn.h>
#include <netinet/in.h>
#include <sys/socket.h>

namespace hord::test {
namespace {

using Clock = std::chrono::steady_clock;
using SendMessage = ssize_t (*)(int, const msghdr*, int);

constexpr std::uint16_t kControlPort = 3956;
constexpr std::size_t kHeaders = 20 + 8;  // IP and UDP
constexpr int kBehind = 3;

SendMessage real_send() {
    static const auto function = reinterpret_cast<SendMessage>(dlsym(RTLD_NEXT, "sendmsg"));
    return function;
}

struct Packet {
    int socket = -1;
    sockaddr_storage to{};
    socklen_t to_size = 0;
    std::vector<char> bytes;
    Clock::time_point due;
};

class Wire {
  public:
    explicit Wire(const NetworkBetween& network) : network_(network), thread_([this] { carry(); }) {}

    ssize_t take(int socket, const msghdr& message) {
        Packet packet;
        packet.socket = socket;
        packet.to_size = message.msg_namelen;
        std::memcpy(&packet.to, message.msg_name, message.msg_namelen);
        for (std::size_t k = 0; k < message.msg_iovlen; ++k) {
            const auto* const at = static_cast<const char*>(message.msg_iov[k].iov_base);
            packet.bytes.insert(packet.bytes.end(), at, at + message.msg_iov[k].iov_len);
        }
        const auto size = static_cast<ssize_t>(packet.bytes.size());
        if (network_.block_zero) renumber(packet.bytes);
        constexpr char kLeader = 1;  // the packet's format, in the lower half of its byte
        if (network_.leader_at > 0 && packet.bytes.size() >= network_.leader_at + 4 &&
            (packet.bytes[4] & 0x0F) == kLeader) {
            for (std::size_t k = 0; k < 4; ++k)
                packet.bytes[network_.leader_at + k] = static_cast<char>(network_.leader_value >> (24 - 8 * k));
        }
        if (network_.mtu_bytes > 0 && packet.bytes.size() + kHeaders > network_.mtu_bytes) return size;
        packet.due = Clock::now() + network_.delay;
        const std::scoped_lock lock(mutex_);
        if (lost(packet)) return size;
        ++count_;
        if (held_.socket < 0 && network_.reorder_every > 0 && count_ % network_.reorder_every == 0) {
            held_ = std::move(packet);
            behind_ = kBehind;
        } else {
            waiting_.push_back(std::move(packet));
            if (held_.socket >= 0 && --behind_ == 0) {
                waiting_.push_back(std::move(held_));
                held_.socket = -1;
            }
        }
        more_.notify_one();
        return size;
    }

    // Of the resend command: sends what was lost of these packets of a block.
    void send_again(std::uint16_t block, std::uint32_t first, std::uint32_t last) {
        const std::scoped_lock lock(mutex_);
        for (auto at = lost_.lower_bound({block, first}); at != lost_.end() && at->first <= std::pair(block, last);) {
            waiting_.push_back(std::move(at->second));
            at = lost_.erase(at);
        }
        more_.notify_one();
    }

  private:
    // Keeps it if it can be asked for. The packet id is the last 24 bits of the header (GVSP 1): 0 begins a frame.
    bool lost(Packet& packet) {
        if (packet.bytes.size() < 8) return false;
        const auto number = [&](std::size_t at) { return std::uint32_t{static_cast<std::uint8_t>(packet.bytes[at])}; };
        const auto block = static_cast<std::uint16_t>(number(2) << 8U | number(3));
        const std::uint32_t id = number(5) << 16U | number(6) << 8U | number(7);
        if (network_.never != 0 && id == network_.never && block % 3 == 0) return true;
        if (network_.lose_every == 0 || id % network_.lose_every != network_.lose_every - 1) return false;
        lost_[{block, id}] = std::move(packet);
        return true;
    }

    // The block id is the second 16-bit number of a packet (GVSP 1).
    void renumber(std::vector<char>& bytes) {
        if (bytes.size() < 4) return;
        const auto id =
            static_cast<std::uint16_t>(static_cast<std::uint8_t>(bytes[2]) << 8U | static_cast<std::uint8_t>(bytes[3]));
        if (id != last_id_) ++blocks_;
        last_id_ = id;
        const auto renumbered = static_cast<std::uint16_t>(65532 + blocks_);
        bytes[2] = static_cast<char>(renumbered >> 8U);
        bytes[3] = static_cast<char>(renumbered & 0xFFU);
    }

    // Nothing may stay behind the last packet of a frame for ever: a held packet leaves after this time.
    static constexpr auto kLongest = std::chrono::milliseconds(2);

    void carry() {
        std::unique_lock lock(mutex_);
        for (;;) {
            if (waiting_.empty()) {
                more_.wait_for(lock, kLongest);
                if (waiting_.empty() && held_.socket >= 0) {
                    waiting_.push_back(std::move(held_));
                    held_.socket = -1;
                }
                continue;
            }
            if (const auto left = waiting_.front().due - Clock::now(); left > Clock::duration::zero()) {
                more_.wait_for(lock, left);
                continue;
            }
            const Packet packet = std::move(waiting_.front());
            waiting_.pop_front();
            lock.unlock();
            (void)::sendto(packet.socket, packet.bytes.data(), packet.bytes.size(), 0,
                           reinterpret_cast<const sockaddr*>(&packet.to), packet.to_size);
            lock.lock();
        }
    }

    const NetworkBetween network_;
    std::mutex mutex_;
    std::condition_variable more_;
    std::deque<Packet> waiting_;
    std::map<std::pair<std::uint16_t, std::uint32_t>, Packet> lost_;  // by block and packet
    Packet held_;
    int behind_ = 0;
    std::size_t count_ = 0;
    std::uint16_t last_id_ = 0;
    std::uint32_t blocks_ = 0;  // so far
    std::thread thread_;
};

std::atomic<Wire*> the_wire = nullptr;
std::atomic<void (*)()> before_answer = nullptr;
std::atomic<unsigned> answers_to_lose = 0;

bool is_lost_answer(const msghdr& message) {
    const auto* const bytes = static_cast<const char*>(message.msg_iov[0].iov_base);
    if (answers_to_lose == 0 || message.msg_iov[0].iov_len < 8 || bytes[6] != 'H' || bytes[7] != 'O') return false;
    --answers_to_lose;
    return true;
}

bool is_stream(int socket) {
    sockaddr_in own{};
    socklen_t size = sizeof own;
    return ::getsockname(socket, reinterpret_cast<sockaddr*>(&own), &size) == 0 && own.sin_family == AF_INET &&
        ntohs(own.sin_port) != kControlPort;
}

}  // namespace

void put_between(const NetworkBetween& network) {
    if (network.mtu_bytes > 0 || network.delay.count() > 0 || network.reorder_every > 0 || network.block_zero ||
        network.lose_every > 0 || network.never > 0 || network.leader_at > 0)
        the_wire = new Wire(network);  // until the process is killed
}

void lose_answers(unsigned count) { answers_to_lose = count; }

void before_each_answer(void (*act)()) { before_answer = act; }

}  // namespace hord::test

// What the camera receives on its control channel. Aravis's fake camera knows no resend command.
extern "C" __attribute__((visibility("default"))) ssize_t recvmsg(int socket, msghdr* message, int flags) {
    using namespace hord::test;
    static const auto real = reinterpret_cast<ssize_t (*)(int, msghdr*, int)>(dlsym(RTLD_NEXT, "recvmsg"));
    const ssize_t size = real(socket, message, flags);
    constexpr std::uint8_t kGvcp = 0x42, kResend = 0x40;
    Wire* const wire = the_wire;
    if (wire == nullptr || size < 20 || message->msg_iov[0].iov_len < 20) return size;
    const auto* const bytes = static_cast<const std::uint8_t*>(message->msg_iov[0].iov_base);
    if (bytes[0] != kGvcp || bytes[2] != 0 || bytes[3] != kResend) return size;
    const auto number = [&](std::size_t at) {
        return std::uint32_t{bytes[at]} << 24U | std::uint32_t{bytes[at + 1]} << 16U |
            std::uint32_t{bytes[at + 2]} << 8U | bytes[at + 3];
    };
    wire->send_again(static_cast<std::uint16_t>(number(8)), number(12) & 0xFF'FFFFU, number(16) & 0xFF'FFFFU);
    return size;
}

extern "C" __attribute__((visibility("default"))) ssize_t sendmsg(int socket, const msghdr* message, int flags) {
    using namespace hord::test;
    Wire* const wire = the_wire;
    const auto act = before_answer.load();
    if ((wire == nullptr && act == nullptr && answers_to_lose == 0) || message->msg_name == nullptr)
        return real_send()(socket, message, flags);
    const bool stream = is_stream(socket);
    if (!stream && is_lost_answer(*message)) return static_cast<ssize_t>(message->msg_iov[0].iov_len);
    if (!stream && act != nullptr) act();
    return stream && wire != nullptr ? wire->take(socket, *message) : real_send()(socket, message, flags);
}
