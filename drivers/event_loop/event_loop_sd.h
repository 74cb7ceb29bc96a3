// The event loop of the service: sd-event on CLOCK_MONOTONIC.
#pragma once

#include <csignal>
#include <initializer_list>
#include <memory>

#include "drivers/hal/event_loop.h"

namespace hord::firmware {

class SdEventLoop final : public hal::EventLoop {
  public:
    // Fails with io when the kernel gives no descriptors.
    static Result<std::unique_ptr<SdEventLoop>> open();
    ~SdEventLoop() override;

    // Blocks these signals and stops the loop when one comes. Call it before any thread is started, so that all inherit
    // the mask.
    Result<void> stop_on_signals(std::initializer_list<int> signals = {SIGINT, SIGTERM});

    // Blocks the signal and runs `callback` on the loop's thread whenever it comes. Before any thread is started. Fails
    // with io.
    Result<void> on_signal(int signal, Callback callback);

    // Runs callbacks until request_stop(); may be run again. Fails with io.
    Result<void> run();

    // Any thread. run() returns soon, after the callbacks that are due now; a stop asked for before run() makes it
    // return at once.
    void request_stop();

    // The signal that stopped the loop; 0: none.
    [[nodiscard]] int stopped_by() const;

  private:
    struct Loop;
    explicit SdEventLoop(std::unique_ptr<Loop> loop);

    hal::TimePoint do_now() const override;
    TimerId do_call_at(hal::TimePoint due, Callback callback) override;
    void do_cancel(TimerId timer) override;
    Result<WatchId> do_watch(int fd, Readiness what, Callback callback) override;
    void do_unwatch(WatchId watch) override;
    void do_post(Callback callback) override;

    std::unique_ptr<Loop> loop_;
};

}  // namespace hord::firmware
