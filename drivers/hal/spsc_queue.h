// A bounded single-producer, single-consumer queue from a thread that must not block to the event loop, with a
// descriptor that becomes readable.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>

#include <sys/eventfd.h>
#include <unistd.h>

#include "common/unique_fd.h"

namespace hord::drivers {

// One thread pushes, one pops. No call blocks or allocates.
template <class T, std::size_t kCapacity>
class SpscQueue {
  public:
    SpscQueue() : event_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}
    SpscQueue(const SpscQueue&) = delete;
    SpscQueue& operator=(const SpscQueue&) = delete;

    [[nodiscard]] int fd() const { return event_.get(); }  // -1: the kernel refused an eventfd

    // False: the queue is full, and the item was not added.
    bool push(const T& item) noexcept {
        const std::size_t at = pushed_.load(std::memory_order_relaxed);
        if (at - popped_.load(std::memory_order_acquire) == kCapacity) return false;
        slots_[at % kCapacity] = item;
        pushed_.store(at + 1, std::memory_order_release);
        notify();
        return true;
    }
    void notify() noexcept {
        const std::uint64_t one = 1;
        [[maybe_unused]] const auto bytes =
            write(event_.get(), &one, sizeof one);  // fails only if the descriptor is readable already
    }

    // Makes the descriptor unreadable. Call it before popping until the queue is empty.
    void acknowledge() noexcept {
        std::uint64_t count = 0;
        [[maybe_unused]] const auto bytes = read(event_.get(), &count, sizeof count);
    }
    std::optional<T> pop() noexcept {
        const std::size_t at = popped_.load(std::memory_order_relaxed);
        if (at == pushed_.load(std::memory_order_acquire)) return std::nullopt;
        const T item = slots_[at % kCapacity];
        popped_.store(at + 1, std::memory_order_release);
        return item;
    }

  private:
    common::UniqueFd event_;
    std::array<T, kCapacity> slots_{};
    std::atomic<std::size_t> pushed_{0}, popped_{0};
};

}  // namespace hord::drivers
