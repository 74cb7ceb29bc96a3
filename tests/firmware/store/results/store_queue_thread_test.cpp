// When the queue's thread does what: never sooner than its intervals say, and at once where it is asked to.
#include <atomic>
#include <thread>

#include "firmware/store/results/store_queue.h"
#include "lab/soak/memory_store.h"
#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::store::test {
namespace {

using namespace std::chrono_literals;
using Steady = std::chrono::steady_clock;

Error full() { return {ErrorCode::io, "results.db cannot grow: the disk is full", "free space"}; }

// A disk in memory that counts what the queue asks of it. The intervals are hours unless a test sets them.
struct Timed {
    StoreQueueOptions options{.commit_every = 1h,
                              .retry_every = 1h,
                              .check_every = 1h,
                              .prune_every = 1h,
                              .stop_within = 1ms,
                              .retry_at_stop = 1ms};
    MemoryDisk disk;
    std::atomic<int> opened = 0, written = 0, pruned = 0;
    std::atomic<bool> is_full = false, absent = false;
    Steady::time_point from;
    std::optional<StoreQueue> queue;

    void begin() {
        disk.on_open = [this] { return ++opened, absent ? std::optional(full()) : std::nullopt; };
        disk.on_write = [this] { return ++written, is_full ? std::optional(full()) : std::nullopt; };
        disk.on_prune = [this] { return ++pruned, std::optional<Error>(); };
        from = Steady::now();
        queue.emplace([this] { return MemoryStore::open(disk); }, options, start(), [] { return kNoon; });
    }
    static bool wait_until(const std::function<bool()>& holds) {
        const auto until = Steady::now() + 60s;
        while (!holds() && Steady::now() < until) std::this_thread::sleep_for(100us);
        return holds();
    }
    [[nodiscard]] Steady::duration passed() const { return Steady::now() - from; }
};

TEST(StoreQueueThread, tries_a_failing_disk_once_an_interval) {
    Timed bench;
    bench.options.retry_every = 20ms;
    bench.absent = true;
    bench.begin();
    ASSERT_TRUE(Timed::wait_until([&] { return bench.opened >= 6; }));
    EXPECT_GE(bench.passed(), 5 * 20ms);
}

TEST(StoreQueueThread, tries_a_failing_disk_at_the_end_for_as_long_as_it_was_told_once_an_interval) {
    Timed bench;
    bench.options.stop_within = 200ms;
    bench.options.retry_at_stop = 50ms;
    bench.begin();
    ASSERT_TRUE(Timed::wait_until([&] { return bench.written == 1; }));
    bench.is_full = true;
    bench.queue->add(result(1));
    bench.from = Steady::now();
    EXPECT_EQ(bench.queue->finish().results, 1U);
    EXPECT_GE(bench.passed(), 200ms);
    EXPECT_LE(bench.written, 1 + 1 + 200 / 50 + 1);
    EXPECT_GE(bench.written, 1 + 2) << "the last attempt is at the end";
}

TEST(StoreQueueThread, gathers_results_for_an_interval_and_writes_them_together) {
    Timed bench;
    bench.options.commit_every = 50ms;
    bench.begin();
    ASSERT_TRUE(Timed::wait_until([&] { return bench.written == 1; }));
    bench.from = Steady::now();
    bench.queue->add(result(1));
    bench.queue->add(result(2));
    ASSERT_TRUE(Timed::wait_until([&] { return bench.queue->state().durable_sequence == 2; }));
    EXPECT_GE(bench.passed(), 50ms);
}

TEST(StoreQueueThread, counts_what_is_being_written_among_what_waits) {
    Timed bench;
    bench.options.capacity = 3;
    bench.options.batch = 2;
    std::atomic<bool> stuck = false, goes_on = false;
    bench.disk.on_written = [&]() -> std::optional<Error> {
        stuck = bench.written > 1;  // the first is the start's row
        while (stuck && !goes_on) std::this_thread::sleep_for(100us);
        return std::nullopt;
    };
    bench.begin();
    ASSERT_TRUE(Timed::wait_until([&] { return bench.written == 1; }));
    bench.queue->add(result(1));
    bench.queue->add(result(2));
    const bool was_stuck = Timed::wait_until([&] { return stuck.load(); });
    bench.queue->add(result(3));
    bench.queue->add(result(4));
    const StoreQueueState state = bench.queue->state();
    goes_on = true;
    EXPECT_TRUE(was_stuck);
    EXPECT_EQ(state.waiting, 3U);
    EXPECT_EQ(state.lost, 1U);
    EXPECT_EQ(state.durable_sequence, 0U) << "not yet";
    EXPECT_FALSE(bench.queue->finish().any());
}

TEST(StoreQueueThread, does_not_wait_for_the_interval_with_full_batches) {
    Timed bench;
    bench.options.batch = 3;
    bench.begin();
    ASSERT_TRUE(Timed::wait_until([&] { return bench.written == 1; }));
    for (std::uint32_t k = 1; k <= 7; ++k) bench.queue->add(result(k));
    ASSERT_TRUE(Timed::wait_until([&] { return bench.queue->state().durable_sequence == 6; }));
    std::this_thread::sleep_for(5ms);
    EXPECT_EQ(bench.queue->state().durable_sequence, 6U) << "one is no batch";
    EXPECT_EQ(bench.queue->acknowledge("plc", kNoon, 7), AckStatus::not_yet);
    ASSERT_TRUE(Timed::wait_until([&] { return bench.queue->state().durable_sequence == 7; }));
    EXPECT_FALSE(bench.queue->finish().any());
}

TEST(StoreQueueThread, writes_at_once_for_an_acknowledgement_and_only_what_was_there_then) {
    Timed bench;
    bench.begin();
    ASSERT_TRUE(Timed::wait_until([&] { return bench.written == 1; }));
    for (std::uint32_t k = 1; k <= 3; k += 2) {
        bench.queue->add(result(k));
        ASSERT_EQ(bench.queue->acknowledge("plc", kNoon, k), AckStatus::not_yet);
        ASSERT_TRUE(Timed::wait_until([&] { return bench.queue->state().durable_sequence == k; }));
        bench.queue->add(result(k + 1));
        std::this_thread::sleep_for(10ms);
        EXPECT_EQ(bench.queue->state().durable_sequence, k) << "nobody asked for the next one";
    }
    EXPECT_FALSE(bench.queue->finish().any());
}

TEST(StoreQueueThread, opens_the_store_before_there_is_a_record_and_prunes_once_an_interval) {
    Timed bench;
    bench.options.retention.keep_days = 1;
    bench.options.commit_every = 1ms;
    bench.options.check_every = 1ms;
    bench.options.prune_every = 30ms;
    bench.begin();
    ASSERT_TRUE(Timed::wait_until([&] { return bench.pruned >= 4; }));
    EXPECT_GE(bench.passed(), 3 * 30ms);
    EXPECT_EQ(bench.opened, 1);
}

TEST(StoreQueueThread, writes_again_when_the_disk_works_again_and_forgets_what_failed) {
    Timed bench;
    bench.options.retry_every = 1ms;
    bench.options.commit_every = 1ms;
    bench.begin();
    ASSERT_TRUE(Timed::wait_until([&] { return bench.written == 1; }));
    bench.is_full = true;
    bench.queue->add(result(1));
    ASSERT_TRUE(Timed::wait_until([&] { return bench.queue->state().failing; }));
    bench.is_full = false;
    ASSERT_TRUE(Timed::wait_until([&] { return bench.queue->state().durable_sequence == 1; }));
    EXPECT_FALSE(bench.queue->state().failing);
    const Unstored left = bench.queue->finish();
    EXPECT_FALSE(left.any());
    EXPECT_EQ(left.why, "");
}

}  // namespace
}  // namespace hord::firmware::store::test
