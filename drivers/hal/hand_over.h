// From one thread that must not block to the event loop: a bounded queue, and a descriptor that is readable while
// something waits.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>

#include <sys/eventfd.h>
#include <unistd.h>

namespace hord::drivers {

// One thread pushes, one pops. Neither waits for the other, nor allocates.
template <class T, std::size_t kRoom>
class HandOver {
  public:
    HandOver() : bell_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}
    ~HandOver() {
        if (bell_ >= 0) close(bell_);
    }
    HandOver(const HandOver&) = delete;
    HandOver& operator=(const HandOver&) = delete;

    [[nodiscard]] int fd() const { return bell_; }  // -1: the kernel had none to give

    // False when it is full: the item is not taken.
    bool push(const T& item) noexcept {
        const std::size_t at = pushed_.load(std::memory_order_relaxed);
        if (at - popped_.load(std::memory_order_acquire) == kRoom) return false;
        room_[at % kRoom] = item;
        pushed_.store(at + 1, std::memory_order_release);
        ring();
        return true;
    }
    void ring() noexcept {
        const std::uint64_t one = 1;
        [[maybe_unused]] const auto bytes = write(bell_, &one, sizeof one);  // refused only where it already rings
    }

    // The bell is silent afterwards; pop until nothing comes.
    void hear() noexcept {
        std::uint64_t count = 0;
        [[maybe_unused]] const auto bytes = read(bell_, &count, sizeof count);
    }
    std::optional<T> pop() noexcept {
        const std::size_t at = popped_.load(std::memory_order_relaxed);
        if (at == pushed_.load(std::memory_order_acquire)) return std::nullopt;
        const T item = room_[at % kRoom];
        popped_.store(at + 1, std::memory_order_release);
        return item;
    }

  private:
    int bell_;
    std::array<T, kRoom> room_{};
    std::atomic<std::size_t> pushed_{0}, popped_{0};
};

}  // namespace hord::drivers
