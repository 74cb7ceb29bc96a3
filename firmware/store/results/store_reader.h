// Reads a store, also while a station writes it: lists, filters, verifies. Blocks; one thread.
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "firmware/store/results/result_store.h"

namespace hord::firmware::store {

class Database;

// A row of results, with the rows it refers to.
struct StoredResult {
    std::int64_t number = 0, run = 0;
    UtcMicros time_us = 0;
    std::uint32_t boot = 0, sequence = 0, part = 0;
    std::string verdict, reason, reject;
    std::optional<double> score;
    std::optional<bool> bounded;  // the score and the defects may be upper bounds; none: an older row, not known
    std::int64_t defect_count = 0;
    std::string defects;  // JSON
    std::int64_t latency_us = 0, reject_latency_us = 0;
    std::int64_t recipe_change = 0;  // number of the change that put it in use; 0: unknown
    std::string recipe, calibration, software;
    std::string damage;  // empty: every column has its type; else what is wrong, and such columns are 0 or empty

    bool operator==(const StoredResult&) const = default;
};

// A row of changes or commands. `what` is "command" for the latter.
struct StoredChange {
    std::int64_t number = 0, run = 0;
    UtcMicros time_us = 0;
    std::string what, peer, name, before, after;
    std::uint32_t token = 0;
    std::string damage;  // as of a result
};

// An empty member does not filter.
struct ResultFilter {
    std::optional<UtcMicros> since, until;  // since <= time < until
    std::string verdict, reason;
    std::string kind;    // of at least one stored defect
    std::string recipe;  // name
    std::optional<std::int64_t> run;
    std::optional<std::int64_t> number, before;  // exactly this number; numbers below it
    std::optional<std::uint32_t> boot, part;
    std::string what;                    // of changes: "recipe", "command", "start" ...
    std::optional<std::int64_t> newest;  // at most so many, the newest
    std::optional<std::int64_t> after;   // of results: numbers above it
    std::optional<std::int64_t> oldest;  // of results: at most so many, the oldest
};

// How many results of a period have the same recipe and outcome.
struct ResultCount {
    UtcMicros since_us = 0;  // start of the period
    std::string recipe, verdict, reason;
    std::string kind;  // of each_kind_count() alone; verdict and reason are then empty
    std::int64_t parts = 0;
};

// The scores of a period; of those that passed and of the others, none: no such part with a score.
struct ScoreCount {
    UtcMicros since_us = 0;  // start of the period
    std::optional<double> passed_mean, passed_highest, other_highest;
};

// The newest row of a chain. Noted outside of the store, it proves later that no row up to it was changed.
struct ChainHead {
    std::string chain;  // "changes", "commands", "results"
    std::int64_t rows = 0, first = 0, number = 0;
    std::string hash;  // hexadecimal; of row `number`
};

struct Verification {
    std::vector<std::string> problems;  // empty: every row is unchanged
    std::vector<ChainHead> heads;
    std::vector<std::string> removed;  // what retention has removed of a chain: rows, times, when and why
};

class StoreReader {
  public:
    // Fails with not_found, unreadable (damaged, not a store), unsupported (written by newer or older software: a
    // station's start brings an older one up to date), io.
    static Result<std::unique_ptr<StoreReader>> open(const std::filesystem::path& folder);
    ~StoreReader();

    [[nodiscard]] const std::string& id() const { return id_; }  // random, of this store
    Result<std::int64_t> newest_number();                        // of results; 0: none yet
    // Later calls fail with timeout after `most`: a long read blocks the checkpoint of the station's write-ahead log.
    void limit_time(std::chrono::milliseconds most);

    // In the order of their numbers.
    Result<void> each_result(const ResultFilter& filter, const std::function<void(const StoredResult&)>& take);
    // Results of since <= time < until, counted by periods of `period`, recipe, verdict and reason; the same of those
    // that did not pass by the kinds of their defects (a part with two kinds counts for both). In the order of time.
    Result<void> each_count(UtcMicros since, UtcMicros until, std::chrono::seconds period,
                            const std::function<void(const ResultCount&)>& take);
    Result<void> each_kind_count(UtcMicros since, UtcMicros until, std::chrono::seconds period,
                                 const std::function<void(const ResultCount&)>& take);
    // Scores of since <= time < until by periods of `period`, in the order of time. A period without a score is left
    // out.
    Result<void> each_score(UtcMicros since, UtcMicros until, std::chrono::seconds period,
                            const std::function<void(const ScoreCount&)>& take);
    Result<void> each_change(const ResultFilter& filter,
                             const std::function<void(const StoredChange&)>& take);  // time, run, what, newest

    // Reads every row. `noted`: heads of earlier verifications; each row must still have that hash, or have been
    // removed by retention. Lists at most 100 problems a chain.
    Result<Verification> verify(const std::vector<ChainHead>& noted = {});

  private:
    StoreReader(std::unique_ptr<Database> database, std::string id);
    const std::unique_ptr<Database> database_;
    const std::string id_;
};

}  // namespace hord::firmware::store
