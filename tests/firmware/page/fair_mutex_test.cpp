#include "firmware/page/fair_mutex.h"

#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace hord::firmware::page {
namespace {

using namespace std::chrono_literals;

TEST(FairMutex, who_asked_first_is_first_even_before_the_thread_that_releases_it) {
    FairMutex mutex;
    std::unique_lock mine(mutex, 10s);
    std::vector<int> order;
    std::thread other([&] {
        const std::unique_lock turn(mutex, 10s);
        if (turn) order.push_back(1);
    });
    while (mutex.held_or_wanted() < 2) std::this_thread::yield();
    mine.unlock();
    if (mine.try_lock_for(10s)) order.push_back(2);
    mine.unlock();
    other.join();
    EXPECT_EQ(order, (std::vector{1, 2}));
}

TEST(FairMutex, who_gave_up_is_not_waited_for) {
    FairMutex mutex;
    std::unique_lock mine(mutex, 0ms);
    ASSERT_TRUE(mine);
    EXPECT_FALSE(std::unique_lock(mutex, 0ms));
    EXPECT_FALSE(std::unique_lock(mutex, 1ms));
    EXPECT_EQ(mutex.held_or_wanted(), 1U);
    mine.unlock();
    EXPECT_EQ(mutex.held_or_wanted(), 0U);
    EXPECT_TRUE(std::unique_lock(mutex, 0ms));
}

}  // namespace
}  // namespace hord::firmware::page
