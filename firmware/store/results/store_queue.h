// A queue between the line and the store: add() never waits for the disk; a thread writes batches.
//
// While the store fails, records wait and the store is opened again every `retry_every`; no record is stored twice.
// Once `capacity` results wait, further results are lost: counted, reported, and recorded as a change "lost" as soon as
// the store works again, one for each run of results without a stored one between them.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "drivers/hal/clock.h"
#include "firmware/store/results/result_store.h"

namespace hord::firmware::store {

struct StoreQueueOptions {
    std::size_t capacity = 65'536;  // records that may wait; about 200 bytes each
    std::size_t batch = 4096;       // records in one transaction
    hal::Duration commit_every = std::chrono::milliseconds(100);
    hal::Duration retry_every = std::chrono::seconds(1);
    hal::Duration check_every = std::chrono::seconds(1);  // whether the files are still there, without records, too
    hal::Duration prune_every = std::chrono::seconds(60);
    hal::Duration stop_within = std::chrono::seconds(3);  // a failing store is tried for so long at the end
    hal::Duration retry_at_stop = std::chrono::milliseconds(200);
    Retention retention = {};
    bool thread = true;  // false: only step() works
};

struct StoreQueueState {
    bool failing = false;
    std::uint32_t durable_sequence = 0;  // all results of this run up to it are durable or counted as lost
    std::size_t waiting = 0;
    std::uint64_t lost = 0;  // records since the start
};

// Records that are in no store at the end.
struct Unstored {
    std::size_t results = 0, others = 0;
    std::uint32_t from_sequence = 0, to_sequence = 0;  // of the results; between them may be stored ones
    std::string why;                                   // the last error of the store

    [[nodiscard]] bool any() const { return results + others > 0; }
    [[nodiscard]] Error error() const;  // names them; its cure is the store's last error
};

class StoreQueue {
  public:
    using Open = std::function<Result<std::unique_ptr<ResultStore>>()>;
    struct Listener {
        std::function<void(const Error&)> failed;  // once a failure; again for another error
        std::function<void()> works_again;
    };

    // `start` describes the run. `listener` is called on the queue's thread, `utc_now` there and in add().
    StoreQueue(Open open, StoreQueueOptions options, StartRecord start, std::function<UtcMicros()> utc_now,
               Listener listener = {});
    // The destructor finishes.

    // Ends the thread. Writes what waits; tries a store that fails until `stop_within` is over. What is left is in no
    // store. Call it once, from the thread that made the queue; records that are added later are not stored.
    Unstored finish();

    // Any thread.
    void add(Record record);

    // Any thread. If every result up to `sequence` is durable, records the acknowledgement by `peer`; else has them
    // written without waiting for `commit_every`.
    AckStatus acknowledge(std::string peer, UtcMicros time_us, std::uint32_t sequence);

    [[nodiscard]] StoreQueueState state() const;

    // Without a thread: opens the store if necessary, writes one batch, prunes. False: it failed.
    bool step();

  private:
    void work(const std::stop_token& stop);
    void drain(std::unique_lock<std::mutex>& lock);
    Result<void> open_and_write(const std::vector<Entry>& batch);
    bool write_one_batch(std::unique_lock<std::mutex>& lock);
    void note_written(const std::vector<Entry>& batch);
    void prune(std::unique_lock<std::mutex>& lock);
    void fail_with(std::unique_lock<std::mutex>& lock, const Error& error);
    void report_losses();

    const Open open_;
    const StoreQueueOptions options_;
    const StartRecord start_;
    const std::function<UtcMicros()> utc_now_;
    const Listener listener_;

    // Used by the queue's thread only.
    std::unique_ptr<ResultStore> store_;
    std::vector<ChangeRecord> in_use_;  // the last change of each kind, for a new store file
    std::string last_error_;
    hal::TimePoint next_prune_{};

    mutable std::mutex mutex_;  // guards the rest
    std::condition_variable_any wake_;
    std::deque<Entry> waiting_;
    std::uint64_t counted_ = 0;
    std::size_t in_flight_ = 0;
    std::uint64_t lost_ = 0, lost_reported_ = 0;
    std::uint32_t lost_from_ = 0, lost_to_ = 0;  // sequences of the next report
    std::uint32_t durable_ = 0;
    bool failing_ = false, urgent_ = false;
    bool moved_ = false;   // the store failed with not_found: what was durable cannot be acknowledged, either
    std::jthread thread_;  // the last member: its end uses the others
};

}  // namespace hord::firmware::store
