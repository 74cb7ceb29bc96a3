// The sd-event loop beyond the contract suite (tests/system/contract): run, stop and signals.
#include "drivers/event_loop/event_loop_sd.h"

#include <csignal>
#include <thread>

#include <gtest/gtest.h>
#include <unistd.h>

namespace hord::firmware {
namespace {

std::unique_ptr<SdEventLoop> open_loop() {
    auto loop = SdEventLoop::open();
    EXPECT_TRUE(loop);
    return std::move(*loop);
}

TEST(SdEventLoop, a_stop_asked_for_before_run_makes_it_return) {
    auto loop = open_loop();
    loop->request_stop();
    EXPECT_TRUE(loop->run());
    EXPECT_EQ(loop->stopped_by(), 0);
}

TEST(SdEventLoop, another_thread_may_stop_it) {
    auto loop = open_loop();
    std::thread other([&] { loop->request_stop(); });
    EXPECT_TRUE(loop->run());
    other.join();
}

// "systemctl stop" and "systemctl kill", or Ctrl-C twice: the process still ends by itself, with its own exit status.
TEST(SdEventLoop, a_signal_that_comes_again_after_the_loop_has_ended_does_not_end_the_process) {
    auto loop = open_loop();
    ASSERT_TRUE(loop->stop_on_signals({SIGUSR1}));
    ASSERT_TRUE(loop->on_signal(SIGUSR2, [] {}));
    kill(getpid(), SIGUSR1);
    EXPECT_TRUE(loop->run());
    kill(getpid(), SIGUSR1);
    kill(getpid(), SIGUSR2);
    loop.reset();
    sigset_t blocked{};
    sigprocmask(SIG_BLOCK, nullptr, &blocked);
    EXPECT_FALSE(sigismember(&blocked, SIGUSR1) || sigismember(&blocked, SIGUSR2));
}

TEST(SdEventLoop, a_signal_stops_it_and_is_named) {
    auto loop = open_loop();
    ASSERT_TRUE(loop->stop_on_signals({SIGUSR1}));
    loop->post([] { kill(getpid(), SIGUSR1); });
    EXPECT_TRUE(loop->run());
    EXPECT_EQ(loop->stopped_by(), SIGUSR1);
}

TEST(SdEventLoop, a_watch_may_end_itself_in_its_own_callback) {
    auto loop = open_loop();
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    int calls = 0;
    hal::EventLoop::WatchId id{};
    const auto watch = loop->watch(ends[0], hal::EventLoop::Readiness::readable, [&] {
        ++calls;
        loop->unwatch(id);
        loop->request_stop();
    });
    ASSERT_TRUE(watch);
    id = *watch;
    ASSERT_EQ(write(ends[1], "x", 1), 1);  // never read: a watch that is not removed would call back endlessly
    EXPECT_TRUE(loop->run());
    EXPECT_EQ(calls, 1);
    close(ends[0]);
    close(ends[1]);
}

TEST(SdEventLoop, a_timer_that_renews_itself_at_once_starves_nobody) {
    auto loop = open_loop();
    int runs = 0;
    std::function<void()> again = [&] {
        ++runs;
        loop->call_after(hal::Duration::zero(), again);
    };
    again();
    loop->post([&] { loop->post([&] { loop->request_stop(); }); });
    EXPECT_TRUE(loop->run());
    EXPECT_GT(runs, 0);
}

}  // namespace
}  // namespace hord::firmware
