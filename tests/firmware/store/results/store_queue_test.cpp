// The queue between line and disk: no record is stored twice or lost silently, and the line never waits for the disk.
#include "firmware/store/results/store_queue.h"

#include <atomic>
#include <future>
#include <stdexcept>

#include "tests/firmware/store/results/queue_bench.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

TEST(StoreQueue, writes_everything_in_order_in_batches) {
    Bench bench({.batch = 4});
    bench.add(1, 10);
    EXPECT_THAT(sequences(bench.disk), IsEmpty());
    for (int k = 0; k < 3; ++k) EXPECT_TRUE(bench.queue.step());
    EXPECT_EQ(sequences(bench.disk), count_to(10));
    EXPECT_EQ(bench.disk.batches, 1 + 3);  // the run's start is one
    EXPECT_EQ(bench.queue.state().waiting, 0U);
    EXPECT_EQ(bench.queue.state().durable_sequence, 10U);
}

TEST(StoreQueue, acknowledges_what_is_durable_and_nothing_else) {
    Bench bench;
    bench.add(1, 5);
    EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 5), AckStatus::not_yet);
    EXPECT_TRUE(bench.queue.step());
    EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 5), AckStatus::recorded);
    bench.add(6, 6);
    EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 6), AckStatus::not_yet);
    EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 3), AckStatus::recorded);
    bench.disk.on_write = [] { return std::optional(full()); };
    EXPECT_FALSE(bench.queue.step());
    EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 6), AckStatus::failed);
    EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 5), AckStatus::recorded);  // it is on the disk
}

TEST(StoreQueue, keeps_results_while_the_disk_is_full_and_writes_them_when_there_is_room) {
    Bench bench;
    bench.add(1, 3);
    EXPECT_TRUE(bench.queue.step());
    bench.disk.on_write = [] { return std::optional(full()); };
    for (std::uint32_t k = 4; k <= 50; ++k) {
        bench.add(k, k);
        EXPECT_FALSE(bench.queue.step());
        EXPECT_TRUE(bench.queue.state().failing);
    }
    EXPECT_THAT(bench.said, ElementsAre(HasSubstr("disk is full")));  // reported once
    bench.disk.on_write = nullptr;
    EXPECT_TRUE(bench.queue.step());
    EXPECT_EQ(sequences(bench.disk), count_to(50));
    EXPECT_EQ(bench.said.back(), "works again");
    EXPECT_FALSE(bench.queue.state().failing);
    EXPECT_EQ(bench.queue.state().lost, 0U);
}

TEST(StoreQueue, opens_a_store_that_was_not_there_at_the_start_and_says_each_different_trouble_once) {
    Bench bench;
    bench.disk.on_open = [] { return std::optional(Error{ErrorCode::io, "no folder", "make it"}); };
    bench.add(1, 2);
    EXPECT_FALSE(bench.queue.step());
    EXPECT_FALSE(bench.queue.step());
    bench.disk.on_open = [] { return std::optional(full()); };
    EXPECT_FALSE(bench.queue.step());
    EXPECT_THAT(bench.said, ElementsAre(HasSubstr("no folder"), HasSubstr("disk is full")));
    bench.disk.on_open = nullptr;
    EXPECT_TRUE(bench.queue.step());
    EXPECT_EQ(sequences(bench.disk), count_to(2));
}

TEST(StoreQueue, says_the_same_trouble_again_when_it_comes_back) {
    Bench bench;
    for (int k = 0; k < 2; ++k) {
        bench.disk.on_write = [] { return std::optional(full()); };
        bench.add(1, 1);
        EXPECT_FALSE(bench.queue.step());
        bench.disk.on_write = nullptr;
        EXPECT_TRUE(bench.queue.step());
    }
    EXPECT_THAT(bench.said,
                ElementsAre(HasSubstr("disk is full"), "works again", HasSubstr("disk is full"), "works again"));
}

TEST(StoreQueue, stores_once_what_an_error_left_in_doubt) {
    Bench bench;
    bench.add(1, 3);
    EXPECT_TRUE(bench.queue.step());
    bench.disk.on_written = [] { return std::optional(Error{ErrorCode::io, "sync failed", "check the disk"}); };
    bench.add(4, 6);
    EXPECT_FALSE(bench.queue.step());
    EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 6), AckStatus::failed);  // in doubt: not acknowledged
    bench.disk.on_written = nullptr;
    bench.add(7, 8);
    EXPECT_TRUE(bench.queue.step());
    EXPECT_EQ(sequences(bench.disk), count_to(8));
}

TEST(StoreQueue, counts_reports_and_records_what_it_had_to_lose) {
    Bench bench({.capacity = 10});
    bench.disk.on_write = [] { return std::optional(full()); };
    bench.add(1, 25);
    EXPECT_FALSE(bench.queue.step());
    EXPECT_EQ(bench.queue.state().lost, 15U);
    EXPECT_EQ(bench.queue.state().waiting, 10U + 1U);  // plus the report of the loss
    bench.queue.add(recipe("b", "2"));                 // recipes still find room: they are few and needed
    EXPECT_EQ(bench.queue.state().lost, 15U);
    bench.disk.on_write = nullptr;
    EXPECT_TRUE(bench.queue.step());
    EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 25),
              AckStatus::recorded);  // lost results do not delay an acknowledgement
    bench.add(26, 27);
    EXPECT_TRUE(bench.queue.step());
    std::vector<std::uint32_t> expected = count_to(10);
    expected.insert(expected.end(), {26, 27});
    EXPECT_EQ(sequences(bench.disk), expected);
    EXPECT_THAT(lost(bench.disk), ElementsAre(R"({"records":15,"from_sequence":11,"to_sequence":25})"));
}

// A result that found room again lies between two losses: it is neither reported as lost nor acknowledged as stored.
TEST(StoreQueue, reports_losses_with_a_stored_result_between_them_apart) {
    Bench bench({.capacity = 10});
    bench.disk.on_write = [] { return std::optional(full()); };
    bench.add(1, 10);
    EXPECT_FALSE(bench.queue.step());
    bench.add(11, 13);
    bench.disk.on_write = nullptr;
    EXPECT_TRUE(bench.queue.step());
    bench.add(14, 25);  // a slow disk: 14 to 22 find room beside the report of 11 to 13
    EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 14), AckStatus::not_yet);
    EXPECT_TRUE(bench.queue.step());
    std::vector<std::uint32_t> expected = count_to(10);
    for (std::uint32_t k = 14; k <= 22; ++k) expected.push_back(k);
    EXPECT_EQ(sequences(bench.disk), expected);
    EXPECT_THAT(lost(bench.disk),
                ElementsAre(R"({"records":3,"from_sequence":11,"to_sequence":13})",
                            R"({"records":3,"from_sequence":23,"to_sequence":25})"));
    EXPECT_EQ(bench.queue.state().durable_sequence, 25U);
}

TEST(StoreQueue, tells_a_new_store_what_is_in_use) {
    Bench bench;
    bench.queue.add(recipe("a", "1"));
    bench.add(1, 1);
    EXPECT_TRUE(bench.queue.step());
    bench.queue.add(recipe("b", "2"));
    EXPECT_TRUE(bench.queue.step());
    // The damaged file was moved away: the next one is empty.
    bench.disk.on_write = [] { return std::optional(full()); };
    bench.add(2, 2);
    EXPECT_FALSE(bench.queue.step());
    bench.disk.on_write = nullptr;
    bench.disk.entries.clear();
    EXPECT_TRUE(bench.queue.step());
    ASSERT_THAT(bench.disk.entries, SizeIs(3));
    EXPECT_TRUE(std::holds_alternative<StartRecord>(bench.disk.entries[0].record));
    EXPECT_EQ(std::get<ChangeRecord>(bench.disk.entries[1].record).after, "2");
    EXPECT_EQ(sequences(bench.disk), std::vector<std::uint32_t>{2});
}

TEST(StoreQueue, never_makes_the_line_wait_for_the_disk) {
    MemoryDisk disk;
    std::promise<void> stuck, go_on;
    bool first = true;
    disk.on_write = [&]() -> std::optional<Error> {
        if (std::exchange(first, false)) {
            stuck.set_value();
            go_on.get_future().wait();  // a disk that hangs
        }
        return std::nullopt;
    };
    std::uint64_t lost = 0;
    {
        StoreQueue queue([&] { return MemoryStore::open(disk); }, {.capacity = 1000}, start(), [] { return kNoon; });
        stuck.get_future().wait();
        for (std::uint32_t k = 1; k <= 1500; ++k) queue.add(result(k));  // returns, or this test never ends
        EXPECT_EQ(queue.acknowledge("plc", kNoon, 1), AckStatus::not_yet);
        EXPECT_EQ(queue.state().waiting, 1000U);
        lost = queue.state().lost;
        go_on.set_value();
    }  // the destructor writes the waiting records
    EXPECT_EQ(lost, 500U);
    EXPECT_EQ(sequences(disk), count_to(1000));
}

TEST(StoreQueue, with_its_thread_keeps_what_is_acknowledged_and_the_rest_at_the_end) {
    const TempFolder folder;
    {
        StoreQueue queue([&]() -> Result<std::unique_ptr<ResultStore>> { return open_sqlite_store(folder.path()); },
                         {.commit_every = std::chrono::hours(1)}, start(), [] { return kNoon; });
        for (std::uint32_t k = 1; k <= 100; ++k) queue.add(result(k));
        while (queue.acknowledge("plc", kNoon, 100) == AckStatus::not_yet)
            std::this_thread::yield();  // an acknowledgement commits at once, not after the hour
        EXPECT_THAT(results(folder), SizeIs(100));
        for (std::uint32_t k = 101; k <= 150; ++k) queue.add(result(k));
    }
    EXPECT_THAT(results(folder), SizeIs(150));
    EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
}

TEST(StoreQueue, prunes_by_itself_and_reports_when_that_fails) {
    Bench bench({.retention = {.keep_days = 1, .max_bytes = 0}});
    bench.add(1, 1);
    EXPECT_TRUE(bench.queue.step());
    EXPECT_EQ(bench.disk.pruned, 1);
    bench.disk.on_prune = [] { return std::optional(full()); };
    EXPECT_FALSE(bench.queue.step());
    EXPECT_THAT(bench.said, SizeIs(1));
}

// What a queue tells of itself, step by step.
TEST(StoreQueue, says_how_many_wait_are_durable_and_are_lost) {
    Bench bench({.capacity = 3, .batch = 2});
    const auto said = [&] {
        const StoreQueueState s = bench.queue.state();
        return std::to_string(s.waiting) + " wait, " + std::to_string(s.durable_sequence) + " durable, " +
            std::to_string(s.lost) + " lost" + (s.failing ? ", failing" : "");
    };
    EXPECT_EQ(said(), "0 wait, 0 durable, 0 lost");
    bench.add(1, 5);
    EXPECT_EQ(said(), "3 wait, 0 durable, 2 lost");
    EXPECT_TRUE(bench.queue.step());
    EXPECT_EQ(said(), "2 wait, 2 durable, 2 lost") << "a result and the record of the loss";
    EXPECT_TRUE(bench.queue.step());
    EXPECT_EQ(said(), "0 wait, 5 durable, 2 lost") << "what is lost delays no acknowledgement";
    bench.disk.on_write = [] { return std::optional(full()); };
    bench.add(6, 6);
    EXPECT_FALSE(bench.queue.step());
    EXPECT_EQ(said(), "1 wait, 5 durable, 2 lost, failing");
    bench.disk.on_write = nullptr;
    EXPECT_TRUE(bench.queue.step());
    EXPECT_EQ(said(), "0 wait, 6 durable, 2 lost");
}

TEST(StoreQueue, stores_who_acknowledged_what_and_when) {
    Bench bench;
    bench.add(1, 2);
    ASSERT_TRUE(bench.queue.step());
    ASSERT_EQ(bench.queue.acknowledge("plc:5", kNoon + 7, 2), AckStatus::recorded);
    ASSERT_TRUE(bench.queue.step());
    const auto* stored = std::get_if<AcknowledgeRecord>(&bench.disk.entries.back().record);
    ASSERT_NE(stored, nullptr);
    EXPECT_EQ(stored->peer, "plc:5");
    EXPECT_EQ(stored->time_us, kNoon + 7);
    EXPECT_EQ(stored->sequence, 2U);
    EXPECT_EQ(bench.disk.entries.back().number, 3U);
}

TEST(StoreQueue, removes_nothing_without_a_limit) {
    for (const Retention& retention : {Retention{0, 0}, Retention{1, 0}, Retention{0, 1}}) {
        Bench bench({.retention = retention});
        EXPECT_TRUE(bench.queue.step());
        EXPECT_EQ(bench.disk.pruned, retention.keep_days + static_cast<int>(retention.max_bytes));
    }
}

TEST(StoreQueue, tells_a_new_store_the_newest_of_each_kind_that_is_in_use) {
    using What = ChangeRecord::What;
    Bench bench;
    for (const What what : {What::recipe, What::configuration, What::calibration, What::recipe, What::command}) {
        ChangeRecord change = recipe("a", std::to_string(bench.queue.state().waiting));
        change.what = what;
        bench.queue.add(change);
    }
    ASSERT_TRUE(bench.queue.step());
    bench.disk.on_write = [] { return std::optional(full()); };
    bench.add(1, 1);
    EXPECT_FALSE(bench.queue.step());
    bench.disk.on_write = nullptr;
    bench.disk.entries.clear();
    ASSERT_TRUE(bench.queue.step());
    std::vector<std::string> told;
    for (const Entry& entry : bench.disk.entries) {
        if (const auto* change = std::get_if<ChangeRecord>(&entry.record)) {
            told.push_back(std::string(name_of(change->what)) + " " + change->after);
            EXPECT_TRUE(change->if_new);
            EXPECT_EQ(entry.number, 0U);
        }
    }
    EXPECT_THAT(told, ElementsAre("configuration 1", "calibration 2", "recipe 3"));
}

TEST(StoreQueue, takes_an_exception_of_the_store_for_a_failure) {
    Bench bench;
    bench.add(1, 2);
    bench.disk.on_open = []() -> std::optional<Error> { throw std::runtime_error("status: Input/output error"); };
    EXPECT_FALSE(bench.queue.step());
    EXPECT_TRUE(bench.queue.state().failing);
    EXPECT_THAT(bench.said, ElementsAre(HasSubstr("Input/output error")));
    bench.disk.on_open = nullptr;
    EXPECT_TRUE(bench.queue.step());
    EXPECT_EQ(sequences(bench.disk), count_to(2));
}

// A store that has more to remove, three times.
class Backlog final : public ResultStore {
  public:
    explicit Backlog(std::atomic<int>& pruned) : pruned_(pruned) {}
    Result<void> write(std::span<const Entry>) override { return {}; }
    Result<bool> prune(const Retention&, const ClockReading&) override { return ++pruned_ < 3; }

  private:
    std::atomic<int>& pruned_;
};

TEST(StoreQueue, with_its_thread_prunes_on_while_there_is_more_and_then_waits) {
    std::atomic<int> pruned = 0;
    const StoreQueueOptions options{.commit_every = std::chrono::milliseconds(1),
                                    .check_every = std::chrono::milliseconds(1),
                                    .prune_every = std::chrono::hours(1),
                                    .retention = {.keep_days = 1, .max_bytes = 0}};
    StoreQueue queue([&]() -> Result<std::unique_ptr<ResultStore>> { return std::make_unique<Backlog>(pruned); },
                     options, start(), [] { return kNoon; });
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (pruned < 3 && std::chrono::steady_clock::now() < until) std::this_thread::yield();
    for (std::uint32_t k = 1; k <= 20; ++k) {
        queue.add(result(k));
        while (queue.acknowledge("plc", kNoon, k) == AckStatus::not_yet) std::this_thread::yield();
    }
    EXPECT_EQ(queue.finish().results, 0U);
    EXPECT_EQ(pruned, 3);
}

TEST(StoreQueue, has_room_for_changes_when_there_is_none_for_results) {
    Bench bench({.capacity = 10});
    bench.disk.on_write = [] { return std::optional(full()); };
    EXPECT_FALSE(bench.queue.step());
    bench.add(1, 10);
    for (int k = 0; k < 1024; ++k) bench.queue.add(recipe("a", std::to_string(k)));
    EXPECT_EQ(bench.queue.state().lost, 0U);
    EXPECT_EQ(bench.queue.state().waiting, 1034U);
    bench.queue.add(recipe("a", "one more"));
    EXPECT_EQ(bench.queue.state().lost, 1U);
    bench.add(11, 11);
    EXPECT_EQ(bench.queue.state().lost, 2U);
    EXPECT_TRUE(bench.queue.state().failing);
    EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 1), AckStatus::failed);
}

// Nobody acknowledges, and the files are looked at in an hour.
TEST(StoreQueue, with_its_thread_writes_a_single_record_without_being_asked) {
    const TempFolder folder;
    const StoreQueueOptions options{.commit_every = std::chrono::milliseconds(1), .check_every = std::chrono::hours(1)};
    StoreQueue queue([&] { return open_sqlite_store(folder.path()); }, options, start(), [] { return kNoon; });
    const auto wait_for = [&](std::uint32_t sequence) {
        const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
        while (queue.state().durable_sequence < sequence && std::chrono::steady_clock::now() < until)
            std::this_thread::yield();
        return queue.state().durable_sequence == sequence;
    };
    for (std::uint32_t k = 1; k <= 3; ++k) {
        queue.add(result(k));
        ASSERT_TRUE(wait_for(k)) << k;
    }
}

}  // namespace
}  // namespace hord::firmware::store::test
