#include "lab/virtual_time/virtual_time.h"

#include <string>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hord::lab {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;

TEST(VirtualTime, jumps_to_each_due_time_and_stops_at_the_end_asked_for) {
    VirtualTime loop;
    std::vector<hal::Duration> seen;
    loop.call_after(30ms, [&] { seen.push_back(loop.now() - VirtualTime::kStart); });
    loop.call_after(10ms, [&] { seen.push_back(loop.now() - VirtualTime::kStart); });
    loop.call_after(31ms, [&] { seen.push_back(loop.now() - VirtualTime::kStart); });
    loop.run_for(30ms);
    EXPECT_THAT(seen, ElementsAre(10ms, 30ms));
    EXPECT_EQ(loop.now(), VirtualTime::kStart + 30ms);
    EXPECT_EQ(loop.pending(), 1U);
}

TEST(VirtualTime, runs_a_timer_due_in_the_past_without_going_backwards) {
    VirtualTime loop;
    loop.run_for(1s);
    hal::TimePoint ran{};
    loop.call_at(VirtualTime::kStart, [&] { ran = loop.now(); });
    loop.run_until(VirtualTime::kStart);  // an end in the past: due work runs, time stays
    EXPECT_EQ(ran, VirtualTime::kStart + 1s);
    EXPECT_EQ(loop.now(), VirtualTime::kStart + 1s);
}

TEST(VirtualTime, an_old_timer_id_never_cancels_its_slots_next_owner) {
    VirtualTime loop;
    bool ran = false;
    const auto first = loop.call_after(1ms, [] {});
    loop.run_for(1ms);
    loop.call_after(1ms, [&] { ran = true; });
    loop.cancel(first);
    loop.run_for(1ms);
    EXPECT_TRUE(ran);
}

TEST(VirtualTime, says_when_it_is_idle_and_when_it_never_will_be) {
    VirtualTime loop;
    loop.call_after(1h, [] {});
    EXPECT_TRUE(loop.run_until_idle(loop.now() + 2h));
    EXPECT_EQ(loop.now(), VirtualTime::kStart + 1h);
    std::function<void()> tick = [&] { loop.call_after(1ms, [&] { tick(); }); };
    tick();
    EXPECT_FALSE(loop.run_until_idle(loop.now() + 1s));
}

TEST(VirtualTime, runs_until_a_condition_holds_and_no_further) {
    VirtualTime loop;
    int count = 0;
    for (int i = 1; i <= 10; ++i) loop.call_after(i * 1ms, [&] { ++count; });
    EXPECT_TRUE(loop.run_until([&] { return count == 3; }, loop.now() + 1s));
    EXPECT_EQ(loop.now(), VirtualTime::kStart + 3ms);
    EXPECT_FALSE(loop.run_until([&] { return count == 11; }, loop.now() + 1s));
    EXPECT_EQ(count, 10);
}

TEST(VirtualTime, what_is_posted_runs_before_time_moves_on_and_after_timers_already_due) {
    VirtualTime loop;
    std::string order;
    loop.call_after(1ms, [&] {
        loop.post([&] { order += 'p'; });
        loop.call_after(0ms, [&] { order += 'a'; });
    });
    loop.call_after(1ms, [&] { order += 'b'; });
    loop.call_after(2ms, [&] { order += 'c'; });
    loop.run_for(2ms);
    EXPECT_EQ(order, "bapc");
}

TEST(VirtualTime, a_callback_may_cancel_another_due_at_the_same_time) {
    VirtualTime loop;
    bool second = false;
    hal::EventLoop::TimerId id{};
    loop.call_after(1ms, [&] { loop.cancel(id); });
    id = loop.call_after(1ms, [&] { second = true; });
    loop.run_for(1ms);
    EXPECT_FALSE(second);
    EXPECT_EQ(loop.pending(), 0U);
}

TEST(VirtualTime, takes_posts_from_another_thread) {
    VirtualTime loop;
    int count = 0;
    {
        std::jthread other([&] {
            for (int i = 0; i < 1000; ++i) loop.post([&] { ++count; });
        });
    }
    loop.run_for(0ms);
    EXPECT_EQ(count, 1000);
}

}  // namespace
}  // namespace hord::lab
