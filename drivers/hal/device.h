// What every device has: start() with a listener, and stop().
#pragma once

#include <string>
#include <utility>

#include "common/result.h"

namespace hord::hal {

template <class DeviceListener>
class Device {
  public:
    using Listener = DeviceListener;
    virtual ~Device() = default;

    // Loop thread. The listener is called on the loop's thread. Fails as the device says, and with invalid_argument
    // when already started; nothing runs then.
    Result<void> start(Listener& listener) {
        if (started_)
            return fail(ErrorCode::invalid_argument, std::string(what_) + " is already started", "stop it first");
        Result<void> done = do_start(listener);
        started_ = done.has_value();
        return done;
    }

    // Loop thread. No call reaches the listener after it returns. Harmless when not started.
    void stop() {
        if (std::exchange(started_, false)) do_stop();
    }

  protected:
    explicit Device(const char* what) : what_(what) {}  // "the strobe"
    [[nodiscard]] bool is_started() const { return started_; }
    [[nodiscard]] tl::unexpected<Error> not_started() const {
        return fail(ErrorCode::disconnected, std::string(what_) + " is not started", "start it and wait for its link");
    }

  private:
    virtual Result<void> do_start(Listener& listener) = 0;
    virtual void do_stop() = 0;
    const char* const what_;
    bool started_ = false;
};

}  // namespace hord::hal
