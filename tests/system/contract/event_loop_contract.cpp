// The contract of drivers/hal/event_loop.h, tested on every backend.
#include <thread>

#include <sys/eventfd.h>
#include <unistd.h>

#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

using namespace std::chrono_literals;

TEST_P(EventLoopContract, a_timer_runs_once_and_never_early) {
    const hal::TimePoint due = h_->now() + 20ms;
    std::vector<hal::TimePoint> ran;
    h_->loop().call_at(due, [&] { ran.push_back(h_->now()); });
    EXPECT_TRUE(h_->run_until([&] { return !ran.empty(); }));
    h_->run_for(kQuiet);
    ASSERT_EQ(ran.size(), 1U);
    EXPECT_GE(ran[0], due);
}

TEST_P(EventLoopContract, timers_run_by_due_time_then_in_the_order_in_which_they_were_made) {
    std::string order;
    const hal::TimePoint at = h_->now() + 10ms;
    h_->loop().call_at(at + 1ms, [&] { order += 'e'; });
    for (const char c : {'b', 'c', 'd'}) h_->loop().call_at(at, [&order, c] { order += c; });
    h_->loop().call_at(at - 1ms, [&] { order += 'a'; });
    EXPECT_TRUE(h_->run_until([&] { return order.size() == 5; }));
    EXPECT_EQ(order, "abcde");
}

TEST_P(EventLoopContract, a_timer_due_in_the_past_runs_soon_and_not_inside_the_call) {
    bool ran = false;
    h_->loop().call_at(h_->now() - 1s, [&] { ran = true; });
    EXPECT_FALSE(ran);
    EXPECT_TRUE(h_->run_until([&] { return ran; }));
}

TEST_P(EventLoopContract, a_cancelled_timer_never_runs) {
    bool ran = false, other = false;
    const auto timer = h_->loop().call_after(5ms, [&] { ran = true; });
    h_->loop().call_after(10ms, [&] { other = true; });
    h_->loop().cancel(timer);
    EXPECT_TRUE(h_->run_until([&] { return other; }));
    h_->run_for(kQuiet);
    EXPECT_FALSE(ran);
}

TEST_P(EventLoopContract, cancelling_what_has_run_or_never_was_is_harmless) {
    int ran = 0;
    const auto first = h_->loop().call_after(1ms, [&] { ++ran; });
    EXPECT_TRUE(h_->run_until([&] { return ran == 1; }));
    h_->loop().call_after(1ms, [&] { ++ran; });
    h_->loop().cancel(first);
    h_->loop().cancel(hal::EventLoop::TimerId::none);
    EXPECT_TRUE(h_->run_until([&] { return ran == 2; }));
}

TEST_P(EventLoopContract, a_callback_may_cancel_a_timer_that_is_already_due) {
    bool second = false, last = false;
    hal::EventLoop::TimerId victim{};
    const hal::TimePoint at = h_->now() + 5ms;
    h_->loop().call_at(at, [&] { h_->loop().cancel(victim); });
    victim = h_->loop().call_at(at, [&] { second = true; });
    h_->loop().call_at(at, [&] { last = true; });
    EXPECT_TRUE(h_->run_until([&] { return last; }));
    EXPECT_FALSE(second);
}

TEST_P(EventLoopContract, a_callback_may_make_timers_and_they_run_after_it_returned) {
    bool inside = false, nested = false, ran = false;
    h_->loop().call_after(1ms, [&] {
        inside = true;
        h_->loop().call_after(0ms, [&] {
            nested = inside;
            ran = true;
        });
        inside = false;
    });
    EXPECT_TRUE(h_->run_until([&] { return ran; }));
    EXPECT_FALSE(nested);
}

TEST_P(EventLoopContract, what_is_posted_runs_in_order_and_not_inside_the_call) {
    std::string order;
    h_->loop().post([&] {
        h_->loop().post([&] { order += 'c'; });
        order += 'a';
    });
    h_->loop().post([&] { order += 'b'; });
    EXPECT_EQ(order, "");
    EXPECT_TRUE(h_->run_until([&] { return order.size() == 3; }));
    EXPECT_EQ(order, "abc");
}

TEST_P(EventLoopContract, another_thread_may_post_and_the_loops_thread_runs_it) {
    std::vector<std::thread::id> ran_on;
    std::jthread other([&] {
        for (int k = 0; k < 100; ++k) h_->loop().post([&] { ran_on.push_back(std::this_thread::get_id()); });
    });
    EXPECT_TRUE(h_->run_until([&] { return ran_on.size() == 100; }));
    EXPECT_THAT(ran_on, testing::Each(std::this_thread::get_id()));
}

TEST_P(EventLoopContract, time_never_goes_backwards) {
    hal::TimePoint last = h_->now();
    int ran = 0;
    for (int k = 0; k < 50; ++k) {
        h_->loop().call_after((50 - k) * 100us, [&] {
            EXPECT_GE(h_->now(), last);
            last = h_->now();
            ++ran;
        });
    }
    EXPECT_TRUE(h_->run_until([&] { return ran == 50; }));
}

TEST_P(EventLoopContract, a_descriptor_is_watched_until_unwatched_or_refused_as_unsupported) {
    const int fd = eventfd(0, EFD_NONBLOCK);
    int calls = 0;
    const auto watch = h_->loop().watch(fd, hal::EventLoop::Readiness::readable, [&] {
        std::uint64_t value = 0;
        EXPECT_EQ(read(fd, &value, sizeof value), static_cast<ssize_t>(sizeof value));
        ++calls;
    });
    if (!watch) {
        EXPECT_EQ(watch.error().code, ErrorCode::unsupported);
        EXPECT_FALSE(watch.error().cure.empty());
    } else {
        const std::uint64_t one = 1;
        for (int k = 1; k <= 3; ++k) {
            ASSERT_EQ(write(fd, &one, sizeof one), static_cast<ssize_t>(sizeof one));
            EXPECT_TRUE(h_->run_until([&] { return calls == k; }));
        }
        h_->loop().unwatch(*watch);
        ASSERT_EQ(write(fd, &one, sizeof one), static_cast<ssize_t>(sizeof one));
        h_->run_for(kQuiet);
        EXPECT_EQ(calls, 3);
    }
    close(fd);
}

TEST_P(EventLoopContract, a_descriptor_that_is_none_is_refused) {
    const auto watch = h_->loop().watch(-1, hal::EventLoop::Readiness::readable, [] {});
    ASSERT_FALSE(watch);
    EXPECT_TRUE(watch.error().code == ErrorCode::io || watch.error().code == ErrorCode::unsupported)
        << watch.error().message();
}

}  // namespace
}  // namespace hord::contract
