// A station's process is killed at random moments, again and again, over one store: what was acknowledged is never
// lost, and the store is never damaged.
//
// HORD_CRASHES sets how often (the long form: 1000), HORD_CRASH_FOLDER where (a real disk), HORD_CRASH_SEED repeats a
// run.
#include <csignal>
#include <cstdlib>
#include <random>

#include <poll.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/store/results/store_queue.h"
#include "tests/firmware/store/results/samples.h"
#include "tests/firmware/store/results/sql.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::IsEmpty;

std::uint64_t number_from_environment(const char* name, std::uint64_t otherwise) {
    const char* text = std::getenv(name);
    return text != nullptr ? std::strtoull(text, nullptr, 10) : otherwise;
}

// Runs until it is killed: parts come, a PLC acknowledges each fourth, the recipe changes at intervals, old rows are
// pruned. Each acknowledged sequence is written to `report`, and only after the acknowledgement was answered.
[[noreturn]] void station(const std::filesystem::path& folder, std::uint32_t boot, int report) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    StoreQueueOptions options;
    options.commit_every = std::chrono::milliseconds(1);
    options.prune_every = std::chrono::milliseconds(3);
    options.retention.max_bytes = 1'500'000;
    StoreQueue queue([&]() -> Result<std::unique_ptr<ResultStore>> { return open_sqlite_store(folder); }, options,
                     start(boot), [] { return kNoon; });
    for (std::uint32_t sequence = 1;; ++sequence) {
        if (sequence % 64 == 1)
            queue.add(recipe("r" + std::to_string(sequence), std::string(200, static_cast<char>('a' + sequence % 26))));
        queue.add(result(sequence, sequence % 10 == 0 ? PartVerdict::reject : PartVerdict::pass));
        if (sequence % 4 != 0) continue;
        while (queue.acknowledge("plc", kNoon, sequence) != AckStatus::recorded) std::this_thread::yield();
        if (::write(report, &sequence, sizeof sequence) != sizeof sequence) _exit(1);
    }
}

// Kills a station `life` after its start, or (reports above 0) after so many reports. Returns the last sequence that it
// reported as acknowledged, or 0.
std::uint32_t live_and_die(const std::filesystem::path& folder, std::uint32_t boot, std::chrono::microseconds life,
                           int reports) {
    int report[2];
    EXPECT_EQ(pipe(report), 0);
    const pid_t child = fork();
    if (child == 0) {
        close(report[0]);
        station(folder, boot, report[1]);
    }
    close(report[1]);
    std::uint32_t acknowledged = 0, next = 0;
    const bool counts = reports > 0;
    const auto end = std::chrono::steady_clock::now() + (counts ? std::chrono::seconds(20) : life);
    pollfd readable{report[0], POLLIN, 0};
    while (true) {
        const auto left =
            std::chrono::duration_cast<std::chrono::nanoseconds>(end - std::chrono::steady_clock::now()).count();
        if (left <= 0) break;
        const timespec wait{left / 1'000'000'000, left % 1'000'000'000};
        if (ppoll(&readable, 1, &wait, nullptr) <= 0) break;
        if (read(report[0], &next, sizeof next) != sizeof next) break;
        acknowledged = next;
        if (counts && --reports == 0) break;
    }
    kill(child, SIGKILL);
    while (read(report[0], &next, sizeof next) == sizeof next) acknowledged = next;  // reported before the kill
    close(report[0]);
    int status = 0;
    waitpid(child, &status, 0);
    EXPECT_TRUE(WIFSIGNALED(status)) << "the station ended by itself";
    return acknowledged;
}

TEST(Crash, no_acknowledged_result_is_lost_and_the_store_stays_whole) {
    const std::uint64_t crashes = number_from_environment("HORD_CRASHES", 150);
    const std::uint64_t seed = number_from_environment("HORD_CRASH_SEED", 20261121);
    const char* where = std::getenv("HORD_CRASH_FOLDER");
    const TempFolder temporary;
    const std::filesystem::path folder =
        where != nullptr ? std::filesystem::path(where) / ("crash-" + std::to_string(getpid())) : temporary.path();
    std::mt19937_64 random(seed);
    std::uint64_t lost = 0, damaged = 0, checked = 0, with_results = 0;
    for (std::uint32_t boot = 1; boot <= crashes; ++boot) {
        // The kill comes at any moment from before the file exists to after some hundred batches. On a real disk a
        // batch takes milliseconds. Every second one waits for a number of results, also on a machine that is held up.
        const auto longest = where != nullptr ? 200'000U : 25'000U;
        const auto life = std::chrono::microseconds(random() % longest);
        const int reports = boot % 2 == 0 ? 1 + static_cast<int>(random() % 20) : 0;
        const std::uint32_t acknowledged = live_and_die(folder, boot, life, reports);
        if (acknowledged == 0 && !std::filesystem::exists(folder / kStoreFile)) continue;
        // Opened as the station does at its next start, which repairs what the kill left behind.
        const auto store = open_sqlite_store(folder);
        if (!store) {
            ++damaged;
            ADD_FAILURE() << "crash " << boot << ": " << store.error().message();
            break;
        }
        checked += acknowledged;
        with_results += acknowledged > 0 ? 1U : 0U;
        if (acknowledged > 0) {
            auto reader = StoreReader::open(folder);
            ASSERT_TRUE(reader) << reader.error().message();
            std::uint32_t first = 0, last = 0, count = 0;
            ResultFilter filter;
            filter.newest = 200'000;
            ASSERT_TRUE((*reader)->each_result(filter, [&](const StoredResult& r) {
                if (r.boot != boot) return;
                first = first == 0 ? r.sequence : first;
                last = r.sequence;
                ++count;
            }));
            // Retention removes only the oldest results. The rest has no gap and reaches at least the acknowledged
            // sequence.
            lost += last < acknowledged ? acknowledged - last : 0U;
            lost += count != last - first + 1 ? 1U : 0U;
        }
        if (boot % 20 == 0 || boot == crashes) {
            const auto problems = verify(folder).problems;
            damaged += problems.empty() ? 0U : 1U;
            EXPECT_THAT(problems, IsEmpty()) << "crash " << boot;
        }
    }
    std::printf(
        "crashes %llu (seed %llu), %llu of them with acknowledged results; acknowledged %llu, lost %llu, damaged "
        "stores %llu\n",
        static_cast<unsigned long long>(crashes), static_cast<unsigned long long>(seed),
        static_cast<unsigned long long>(with_results), static_cast<unsigned long long>(checked),
        static_cast<unsigned long long>(lost), static_cast<unsigned long long>(damaged));
    EXPECT_EQ(lost, 0U);
    EXPECT_EQ(damaged, 0U);
    EXPECT_GT(with_results, crashes / 4) << "killed too early to show anything";
    if (where != nullptr) std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace hord::firmware::store::test
