// An unbounded queue between threads. push() and pop() lock a mutex for a short time and do not wait for items.
#pragma once

#include <deque>
#include <mutex>
#include <optional>
#include <utility>

namespace hord::drivers {

template <class T>
class ThreadSafeQueue {
  public:
    void push(T item) {
        const std::scoped_lock lock(mutex_);
        items_.push_back(std::move(item));
    }
    std::optional<T> pop() {
        const std::scoped_lock lock(mutex_);
        if (items_.empty()) return std::nullopt;
        std::optional<T> item(std::move(items_.front()));
        items_.pop_front();
        return item;
    }

  private:
    std::mutex mutex_;
    std::deque<T> items_;
};

}  // namespace hord::drivers
