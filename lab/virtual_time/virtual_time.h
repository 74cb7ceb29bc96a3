// Virtual time: an event loop whose clock jumps from one due time to the next. A day of production takes seconds.
//
// The order depends only on the calls, never on the machine: timers run by due time, then in the order of their
// creation. A timer due in the past runs at now(). post() creates a timer due at now() when the running callback
// returns; if another thread posts, that moment is not reproducible. Nothing is allocated once the number of pending
// timers has reached its maximum, if the captures of the callbacks fit into std::function (two pointers).
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <vector>

#include "drivers/hal/event_loop.h"

namespace hord::lab {

class VirtualTime final : public hal::EventLoop {
  public:
    // Time starts at one second, so that a default TimePoint lies in the past.
    static constexpr hal::TimePoint kStart{std::chrono::seconds(1)};
    explicit VirtualTime(hal::TimePoint start = kStart) : now_(start) {}

    // Runs everything due up to and including `end`; now() is then `end` (or stays, when `end` is in the past).
    void run_until(hal::TimePoint end);
    void run_for(hal::Duration duration) { run_until(now_ + duration); }

    // Runs callbacks until `done` returns true; it is called before the first and after each of them. False when
    // nothing due up to and including `limit` is left to run. now() is the time of the last callback.
    bool run_until(const std::function<bool()>& done, hal::TimePoint limit);

    // Runs until no timer is left; false when timers due after `limit` remain (a periodic timer never ends).
    bool run_until_idle(hal::TimePoint limit);

    // The process is not scheduled for this long: callbacks due meanwhile run late. Loop thread, also inside a
    // callback.
    void stall(hal::Duration amount) { now_ += amount; }

    // Runs the next callback only; false when there is none.
    bool run_one();

    [[nodiscard]] std::optional<hal::TimePoint> next_due();
    [[nodiscard]] std::size_t pending() const { return pending_; }  // timers, without what is posted
    [[nodiscard]] std::uint64_t callbacks_run() const { return run_; }

    hal::TimePoint now() const override { return now_; }
    TimerId call_at(hal::TimePoint due, Callback callback) override;
    void cancel(TimerId timer) override;
    Result<WatchId> watch(int fd, Readiness what, Callback callback) override;
    void unwatch(WatchId) override {}
    void post(Callback callback) override;

  private:
    struct Due {  // one entry of the heap; stale when the slot's generation has moved on
        hal::TimePoint at;
        std::uint64_t order;
        std::uint32_t slot;
        std::uint32_t generation;
    };
    struct Slot {
        Callback callback;
        std::uint32_t generation = 1;
        bool used = false;
    };
    struct Later {  // a type, so that the heap's functions inline it
        bool operator()(const Due& a, const Due& b) const { return a.at != b.at ? a.at > b.at : a.order > b.order; }
    };

    void take_posted();
    void run_next();  // next_due() has found it
    void release(std::uint32_t slot);

    hal::TimePoint now_;
    std::vector<Due> heap_;
    std::vector<Slot> slots_;
    std::vector<std::uint32_t> free_;
    std::uint64_t order_ = 0;
    std::uint64_t run_ = 0;
    std::size_t pending_ = 0;

    std::mutex post_mutex_;
    std::vector<Callback> posted_, taken_;
    std::atomic<bool> has_posted_{false};
};

}  // namespace hord::lab
