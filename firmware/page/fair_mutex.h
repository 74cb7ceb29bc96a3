// A mutex with a time limit that is given in the order of asking: std::timed_mutex may give it again and again to a
// thread that has just released it, and others time out. For std::unique_lock.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <mutex>

namespace hord::firmware::page {

class FairMutex {
  public:
    bool try_lock_for(std::chrono::milliseconds most) {
        std::unique_lock lock(mutex_);
        const std::uint64_t mine = next_++;
        turns_.push_back(mine);
        if (turn_.wait_for(lock, most, [&] { return turns_.front() == mine; })) return true;
        std::erase(turns_, mine);
        return false;
    }
    void unlock() {
        {
            const std::lock_guard lock(mutex_);
            turns_.pop_front();
        }
        turn_.notify_all();
    }
    [[nodiscard]] std::size_t held_or_wanted() const {  // by so many
        const std::lock_guard lock(mutex_);
        return turns_.size();
    }

  private:
    mutable std::mutex mutex_;
    std::condition_variable turn_;
    std::deque<std::uint64_t> turns_;  // the first one has the mutex
    std::uint64_t next_ = 0;
};

}  // namespace hord::firmware::page
