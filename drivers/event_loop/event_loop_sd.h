// The event loop of the service: sd-event on CLOCK_MONOTONIC.
#pragma once

#include <csignal>
#include <functional>
#include <initializer_list>
#include <memory>

#include "drivers/hal/event_loop.h"

namespace hord::firmware {

class SdEventLoop final : public hal::EventLoop {
  public:
    // Fails with io (no descriptors).
    static Result<std::unique_ptr<SdEventLoop>> open();
    ~SdEventLoop() override;

    // Blocks these signals and stops the loop when one arrives. Call it before any thread starts, so that all inherit
    // the mask.
    Result<void> stop_on_signals(std::initializer_list<int> signals = {SIGINT, SIGTERM});

    // Blocks the signal and runs `callback` on the loop's thread when it arrives. Call it before any thread starts.
    // Fails with io.
    Result<void> on_signal(int signal, Callback callback);

    // Runs callbacks until request_stop(); may be run again. Fails with io.
    Result<void> run();

    // Runs callbacks until `done`, asked every millisecond, is true, `patience` is over or the loop is stopped. Returns
    // whether it was true.
    bool run_until(const std::function<bool()>& done, hal::Duration patience);

    // Any thread. run() returns after the callbacks that are due now; a request before run() makes it return at once.
    void request_stop();

    // The signal that stopped the loop; 0: none.
    [[nodiscard]] int stopped_by() const;

    hal::TimePoint now() const override;
    TimerId call_at(hal::TimePoint due, Callback callback) override;
    void cancel(TimerId timer) override;
    Result<WatchId> watch(int fd, Readiness what, Callback callback) override;
    void unwatch(WatchId watch) override;
    void post(Callback callback) override;

  private:
    struct Loop;
    explicit SdEventLoop(std::unique_ptr<Loop> loop);

    std::unique_ptr<Loop> loop_;
};

}  // namespace hord::firmware
