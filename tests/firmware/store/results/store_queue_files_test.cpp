// The queue, when the files of its store are moved, removed or replaced while the station runs.

#include <fstream>
#include <future>

#include "tests/firmware/store/results/queue_bench.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

// A real store that fails when the test asks for it.
class Fragile final : public ResultStore {
  public:
    Fragile(std::unique_ptr<ResultStore> inner, const bool& fails) : inner_(std::move(inner)), fails_(fails) {}
    Result<void> write(std::span<const Entry> entries) override {
        return fails_ ? tl::unexpected(full()) : inner_->write(entries);
    }
    Result<bool> prune(const Retention& retention, const ClockReading& now) override {
        return inner_->prune(retention, now);
    }

  private:
    std::unique_ptr<ResultStore> inner_;
    const bool& fails_;
};

TEST(StoreQueue, starts_a_new_file_when_somebody_moved_a_damaged_one_away) {
    const TempFolder folder;
    bool fails = false;
    const auto opener = [&]() -> Result<std::unique_ptr<ResultStore>> {
        auto store = open_sqlite_store(folder.path());
        if (!store) return tl::unexpected(store.error());
        return std::unique_ptr<ResultStore>(std::make_unique<Fragile>(std::move(*store), fails));
    };
    StoreQueue queue(opener, {.thread = false}, start(), [] { return kNoon; });
    queue.add(recipe("a", "1"));
    queue.add(result(1));
    ASSERT_TRUE(queue.step());
    fails = true;
    queue.add(result(2));
    ASSERT_FALSE(queue.step());
    for (const char* name : {"results.db", "results.db-wal", "results.db-shm"})
        std::filesystem::remove(folder.path() / name);
    fails = false;
    ASSERT_TRUE(queue.step());
    const auto all = results(folder);
    ASSERT_THAT(all, SizeIs(1));
    EXPECT_EQ(all[0].sequence, 2U);
    EXPECT_EQ(all[0].recipe, "a");
    EXPECT_EQ(all[0].boot, 7U);
    EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
}

// A real store with the station's opener, and a place to move its files to.
struct MovedStore {
    void move(const std::vector<std::string>& names, const TempFolder& from, const TempFolder& to) const {
        for (const std::string& name : names) std::filesystem::rename(from.path() / name, to.path() / name);
    }
    const std::vector<std::string> all{"results.db", "results.db-wal", "results.db-shm"};
    TempFolder folder, elsewhere;
    std::vector<std::string> said;
    StoreQueue queue{[this, options = SqliteStoreOptions{}] { return open_sqlite_store(folder.path(), options); },
                     {.thread = false},
                     start(),
                     [] { return kNoon; },
                     {[this](const Error& error) { said.push_back(error.message()); },
                      [this] { said.emplace_back("works again"); }}};
};

TEST(StoreQueue, acknowledges_nothing_while_the_file_is_moved_and_goes_on_when_it_is_put_back) {
    for (const bool all : {true, false}) {
        MovedStore bench;
        const auto names = all ? bench.all : std::vector<std::string>{"results.db"};
        bench.queue.add(result(1));
        ASSERT_TRUE(bench.queue.step());
        bench.move(names, bench.folder, bench.elsewhere);
        EXPECT_FALSE(bench.queue.step());  // without a record, too
        EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 1), AckStatus::failed);
        bench.queue.add(result(2));
        EXPECT_FALSE(bench.queue.step());
        EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 2), AckStatus::failed);
        EXPECT_FALSE(std::filesystem::exists(bench.folder.path() / kStoreFile));
        EXPECT_THAT(bench.said, ElementsAre(HasSubstr("results.db was moved, removed or replaced")));
        bench.move(names, bench.elsewhere, bench.folder);
        ASSERT_TRUE(bench.queue.step());
        EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 2), AckStatus::recorded);
        EXPECT_THAT(results(bench.folder), SizeIs(2));
        EXPECT_THAT(verify(bench.folder.path()).problems, IsEmpty());
        EXPECT_EQ(bench.said.back(), "works again");
    }
}

TEST(StoreQueue, notices_that_its_whole_folder_was_replaced) {
    namespace fs = std::filesystem;
    MovedStore bench;
    const fs::path &here = bench.folder.path(), away = bench.elsewhere.path() / "store", copy = away.string() + "2";
    bench.queue.add(result(1));
    ASSERT_TRUE(bench.queue.step());
    fs::rename(here, away);
    fs::create_directory(here);
    EXPECT_FALSE(bench.queue.step());
    EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 1), AckStatus::failed);
    EXPECT_TRUE(fs::is_empty(here)) << "a new store would hide the old one";
    fs::remove(here);
    fs::rename(away, here);
    ASSERT_TRUE(bench.queue.step());
    fs::copy(here, copy);
    fs::rename(here, away);
    fs::rename(copy, here);  // the same files by name and content
    EXPECT_FALSE(bench.queue.step());
    fs::rename(here, copy);
    fs::rename(away, here);
    ASSERT_TRUE(bench.queue.step());
    EXPECT_EQ(bench.queue.acknowledge("plc", kNoon, 1), AckStatus::recorded);
    EXPECT_THAT(verify(here).problems, IsEmpty());
}

TEST(StoreQueue, takes_no_batch_for_durable_that_went_to_a_file_without_a_name) {
    MovedStore bench;
    bench.queue.add(result(1));
    ASSERT_TRUE(bench.queue.step());
    for (const std::string& name : bench.all) std::filesystem::remove(bench.folder.path() / name);
    bench.queue.add(result(2));
    EXPECT_FALSE(bench.queue.step());
    EXPECT_EQ(bench.queue.state().waiting, 1U);
    // Another store at its place is used; a restart would begin a new one.
    write(bench.folder, Story(start(6)).add_results(1, 3));
    ASSERT_TRUE(bench.queue.step());
    EXPECT_THAT(results(bench.folder), SizeIs(4));
}

TEST(StoreQueue, loses_nothing_when_only_the_files_beside_the_database_are_removed) {
    for (const char* name : {"results.db-wal", "results.db-shm"}) {
        MovedStore bench;
        bench.queue.add(result(1));
        ASSERT_TRUE(bench.queue.step());
        std::filesystem::remove(bench.folder.path() / name);
        bench.queue.add(result(2));
        EXPECT_FALSE(bench.queue.step());
        EXPECT_THAT(bench.said, ElementsAre(HasSubstr(std::string(name) + " was moved")));
        ASSERT_TRUE(bench.queue.step());
        EXPECT_THAT(results(bench.folder), SizeIs(2)) << name;
        EXPECT_THAT(verify(bench.folder.path()).problems, IsEmpty());
    }
}

TEST(StoreQueue, with_its_thread_notices_without_a_part_that_its_file_is_gone) {
    const TempFolder folder;
    std::promise<std::string> said;
    StoreQueue queue([&, options = SqliteStoreOptions{}] { return open_sqlite_store(folder.path(), options); },
                     {.check_every = std::chrono::milliseconds(1)}, start(), [] { return kNoon; },
                     {[&](const Error& error) { said.set_value(error.message()); }, [] {}});
    queue.add(result(1));
    while (queue.acknowledge("plc", kNoon, 1) == AckStatus::not_yet) std::this_thread::yield();
    std::filesystem::remove(folder.path() / kStoreFile);
    EXPECT_THAT(said.get_future().get(), HasSubstr("restart the station"));
}

TEST(StoreQueue, never_removes_the_log_of_a_file_that_is_missing) {
    MovedStore bench;
    std::ofstream(bench.folder.path() / "results.db-wal") << "results";
    EXPECT_FALSE(bench.queue.step());
    EXPECT_TRUE(std::filesystem::exists(bench.folder.path() / "results.db-wal"));
    EXPECT_THAT(bench.said, ElementsAre(HasSubstr("results.db-wal is there, but its results.db is not")));
}

}  // namespace
}  // namespace hord::firmware::store::test
