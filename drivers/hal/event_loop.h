// The event loop under all devices. One thread runs it and calls every listener of the devices.
//
// Two backends: sd-event in the service (real time) and a virtual-time scheduler in simulation. Simulated devices use
// only timers and run on both; real drivers also watch descriptors.
#pragma once

#include <cstdint>
#include <functional>

#include "common/result.h"
#include "drivers/hal/clock.h"

namespace hord::hal {

class EventLoop : public Clock {
  public:
    using Callback = std::function<void()>;
    enum class TimerId : std::uint64_t { none = 0 };
    enum class WatchId : std::uint64_t { none = 0 };
    enum class Readiness : std::uint8_t { readable = 1, writable = 2, readable_and_writable = 3 };

    // Loop thread. Runs `callback` once, at `due` or later. Timers with the same due time run in the order of creation.
    TimerId call_at(TimePoint due, Callback callback) { return do_call_at(due, std::move(callback)); }
    TimerId call_after(Duration delay, Callback callback) { return do_call_at(now() + delay, std::move(callback)); }

    // Loop thread. No effect on a timer that has run or does not exist.
    void cancel(TimerId timer) { do_cancel(timer); }

    // Loop thread. Runs `callback` whenever `fd` is ready, until unwatch(). The caller keeps the descriptor open.
    // Fails with unsupported in virtual time, io when the kernel refuses the descriptor.
    Result<WatchId> watch(int fd, Readiness what, Callback callback) { return do_watch(fd, what, std::move(callback)); }
    void unwatch(WatchId watch) { do_unwatch(watch); }

    // Any thread. Runs `callback` on the loop's thread soon.
    void post(Callback callback) { do_post(std::move(callback)); }

  private:
    virtual TimerId do_call_at(TimePoint due, Callback callback) = 0;
    virtual void do_cancel(TimerId timer) = 0;
    virtual Result<WatchId> do_watch(int fd, Readiness what, Callback callback) = 0;
    virtual void do_unwatch(WatchId watch) = 0;
    virtual void do_post(Callback callback) = 0;
};

}  // namespace hord::hal
