// A store in a folder of its own, and records to put into it.
#pragma once

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>

#include "firmware/store/results/sqlite_store.h"
#include "firmware/store/results/store_reader.h"

namespace hord::firmware::store::test {

// In memory where that is possible: the tests sync some thousand times.
class TempFolder {
  public:
    TempFolder() {
        const char* base = std::filesystem::is_directory("/dev/shm") ? "/dev/shm" : "/tmp";
        std::string name = std::string(base) + "/hord-store-XXXXXX";
        EXPECT_NE(mkdtemp(name.data()), nullptr);
        path_ = name;
    }
    ~TempFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    TempFolder(const TempFolder&) = delete;
    TempFolder& operator=(const TempFolder&) = delete;
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }

  private:
    std::filesystem::path path_;
};

inline void write_text(const std::filesystem::path& file, const std::string& text) {
    std::ofstream(file, std::ios::binary) << text;
}
inline std::string read_text(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

constexpr UtcMicros kSecond = 1'000'000;
constexpr UtcMicros kDay = 86'400 * kSecond;
constexpr UtcMicros kNoon = 1'790'000'000 * kSecond;  // some day in 2026

inline StartRecord start(std::uint32_t boot = 7) { return {kNoon, boot, "cell 3", "0.1.0"}; }

inline ResultRecord result(std::uint32_t sequence, PartVerdict verdict = PartVerdict::pass) {
    ResultRecord record;
    record.result.sequence = sequence;
    record.result.part = sequence + 100;
    record.result.verdict = verdict;
    record.result.latency_us = 4200 + sequence;
    record.result.score = 0.1F * static_cast<float>(sequence % 30);
    record.result.bounded = sequence % 30 == 2;
    record.time_us = kNoon + sequence * 100'000LL;
    if (verdict == PartVerdict::reject) {
        record.result.reason = PartReason::neighbours_disagree;
        record.result.reject = RejectState::confirmed;
        record.result.reject_latency_us = 400'000;
        record.defects = {{12.25F, 3.5F, 9, 1.7F, algo::DefectKind::scratch},
                          {40, 41, 4, 1.1F, algo::DefectKind::absorbing}};
        record.result.defects = 2;
    }
    return record;
}

inline ChangeRecord recipe(const std::string& name, const std::string& text) {
    ChangeRecord change;
    change.what = ChangeRecord::What::recipe;
    change.time_us = kNoon;
    change.name = name;
    change.after = text;
    return change;
}

// Counts entries as StoreQueue does.
class Story {
  public:
    explicit Story(const StartRecord& record = start()) { entries_.push_back({0, record}); }
    Story& add(Record record) {
        entries_.push_back({++count_, std::move(record)});
        return *this;
    }
    Story& add_results(std::uint32_t from, std::uint32_t to) {
        for (std::uint32_t k = from; k <= to; ++k)
            add(result(k, k % 10 == 0 ? PartVerdict::reject : PartVerdict::pass));
        return *this;
    }
    [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }

  private:
    std::vector<Entry> entries_;
    std::uint64_t count_ = 0;
};

inline std::unique_ptr<ResultStore> open(const TempFolder& folder, const SqliteStoreOptions& options = {}) {
    auto store = open_sqlite_store(folder.path(), options);
    EXPECT_TRUE(store) << store.error().message();
    return store ? std::move(*store) : nullptr;
}

inline void write(const TempFolder& folder, const Story& run) {
    const auto store = open(folder);
    const auto done = store->write(run.entries());
    EXPECT_TRUE(done) << done.error().message();
}

inline std::vector<StoredResult> results(const TempFolder& folder, const ResultFilter& filter = {}) {
    std::vector<StoredResult> all;
    auto reader = StoreReader::open(folder.path());
    EXPECT_TRUE(reader) << reader.error().message();
    if (!reader) return all;
    const auto done = (*reader)->each_result(filter, [&](const StoredResult& r) { all.push_back(r); });
    EXPECT_TRUE(done) << done.error().message();
    return all;
}

inline std::vector<StoredChange> changes(const TempFolder& folder, const ResultFilter& filter = {}) {
    std::vector<StoredChange> all;
    auto reader = StoreReader::open(folder.path());
    EXPECT_TRUE(reader) << reader.error().message();
    if (!reader) return all;
    const auto done = (*reader)->each_change(filter, [&](const StoredChange& c) { all.push_back(c); });
    EXPECT_TRUE(done) << done.error().message();
    return all;
}

inline Verification verify(const std::filesystem::path& folder, const std::vector<ChainHead>& noted = {}) {
    auto reader = StoreReader::open(folder);
    if (!reader) return {{reader.error().message()}, {}, {}};
    auto verification = (*reader)->verify(noted);
    if (!verification) return {{verification.error().message()}, {}, {}};
    return *verification;
}

// Lets days pass by both clocks: each day the clock shows the same day for long enough, and the store prunes.
struct Calendar {
    ClockReading now{kNoon, 1000 * kSecond};

    void pass(UtcMicros time_us) {
        now.utc_us += time_us;
        now.steady_us += time_us;
    }
    Result<bool> witness(ResultStore& store, const Retention& retention) {
        (void)store.prune(retention, now);
        pass(600 * kSecond);
        auto more = store.prune(retention, now);
        pass(-600 * kSecond);
        return more;
    }
    // Each day is witnessed. The first is that of `now`; then `now` is a day later.
    Result<bool> live(ResultStore& store, const Retention& retention, int days) {
        Result<bool> more = false;
        for (int k = 0; k < days && more; ++k) {
            more = witness(store, retention);
            pass(kDay);
        }
        return more;
    }
};

}  // namespace hord::firmware::store::test
