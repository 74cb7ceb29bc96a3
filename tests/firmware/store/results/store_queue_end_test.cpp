// The end of the queue: what is stored within its time, and what is told of the rest.

#include "tests/firmware/store/results/queue_bench.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::HasSubstr;

StoreQueueOptions ends_soon() {
    return {.stop_within = std::chrono::milliseconds(100), .retry_at_stop = std::chrono::milliseconds(1)};
}

TEST(StoreQueue, says_at_the_end_what_could_not_be_stored) {
    MemoryDisk disk;
    std::atomic<bool> is_full = false;
    disk.on_write = [&] { return is_full ? std::optional(full()) : std::nullopt; };
    StoreQueue queue([&] { return MemoryStore::open(disk); }, ends_soon(), start(), [] { return kNoon; });
    for (std::uint32_t k = 1; k <= 37; ++k) queue.add(result(k));
    while (queue.acknowledge("plc", kNoon, 37) != AckStatus::recorded) std::this_thread::yield();
    is_full = true;
    for (std::uint32_t k = 38; k <= 120; ++k) queue.add(result(k));
    const Unstored left = queue.finish();
    EXPECT_EQ(left.results, 83U);
    EXPECT_EQ(left.from_sequence, 38U);
    EXPECT_EQ(left.to_sequence, 120U);
    EXPECT_THAT(left.error().what, HasSubstr("83 results (sequences 38 to 120)"));
    EXPECT_THAT(left.error().cure, HasSubstr("disk is full"));
    EXPECT_EQ(sequences(disk), count_to(37));
}

TEST(StoreQueue, counts_at_the_end_what_found_no_room_in_memory_before) {
    MemoryDisk disk;
    disk.on_open = [] { return std::optional(full()); };
    StoreQueueOptions options = ends_soon();
    options.capacity = 10;
    StoreQueue queue([&] { return MemoryStore::open(disk); }, options, start(), [] { return kNoon; });
    for (std::uint32_t k = 1; k <= 25; ++k) queue.add(result(k));
    const Unstored left = queue.finish();
    EXPECT_EQ(left.results, 25U);
    EXPECT_EQ(left.from_sequence, 1U);
    EXPECT_EQ(left.to_sequence, 25U);
}

// The loss is not yet among the records that wait for the disk.
TEST(StoreQueue, counts_at_the_end_a_loss_that_no_record_tells) {
    Bench bench({.capacity = 10});
    bench.disk.on_write = [] { return std::optional(full()); };
    EXPECT_FALSE(bench.queue.step());
    bench.add(1, 25);
    const Unstored left = bench.queue.finish();
    EXPECT_EQ(left.results, 25U);
    EXPECT_EQ(left.to_sequence, 25U);
}

TEST(StoreQueue, names_at_the_end_results_and_other_records) {
    Unstored left;
    left.results = 3;
    left.from_sequence = 7;
    left.to_sequence = 9;
    EXPECT_EQ(left.error().what, "3 results (sequences 7 to 9) could not be stored before the end and are lost");
    left.others = 2;
    EXPECT_EQ(left.error().what,
              "3 results (sequences 7 to 9) and 2 other records could not be stored before the end and are lost");
    left.results = 0;
    EXPECT_EQ(left.error().what, "2 other records could not be stored before the end and are lost");
}

TEST(StoreQueue, keeps_everything_if_the_disk_has_room_again_before_the_end_is_over) {
    MemoryDisk disk;
    int attempts = 0;
    disk.on_write = [&] { return ++attempts <= 5 ? std::optional(full()) : std::nullopt; };
    StoreQueueOptions options = ends_soon();
    options.stop_within = std::chrono::hours(1);
    StoreQueue queue([&] { return MemoryStore::open(disk); }, options, start(), [] { return kNoon; });
    for (std::uint32_t k = 1; k <= 20; ++k) queue.add(result(k));
    EXPECT_FALSE(queue.finish().any());
    EXPECT_EQ(sequences(disk), count_to(20));
}

TEST(StoreQueue, counts_at_the_end_other_records_apart) {
    Bench bench;
    bench.disk.on_write = [] { return std::optional(full()); };
    bench.queue.add(recipe("a", "1"));
    EXPECT_FALSE(bench.queue.step());
    bench.add(4, 6);
    const Unstored left = bench.queue.finish();
    EXPECT_TRUE(left.any());
    EXPECT_EQ(left.results, 3U);
    EXPECT_EQ(left.from_sequence, 4U);
    EXPECT_EQ(left.to_sequence, 6U);
    EXPECT_EQ(left.others, 1U);
    EXPECT_THAT(left.why, HasSubstr("disk is full"));
}

}  // namespace
}  // namespace hord::firmware::store::test
