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
    virtual TimerId call_at(TimePoint due, Callback callback) = 0;
    TimerId call_after(Duration delay, Callback callback) { return call_at(now() + delay, std::move(callback)); }

    // Loop thread. No effect on a timer that has run or does not exist.
    virtual void cancel(TimerId timer) = 0;

    // Loop thread. Runs `callback` whenever `fd` is ready, until unwatch(). The caller keeps the descriptor open.
    // Fails with unsupported in virtual time, io when the kernel refuses the descriptor.
    virtual Result<WatchId> watch(int fd, Readiness what, Callback callback) = 0;
    virtual void unwatch(WatchId watch) = 0;

    // Any thread. Runs `callback` on the loop's thread soon.
    virtual void post(Callback callback) = 0;
};

}  // namespace hord::hal
