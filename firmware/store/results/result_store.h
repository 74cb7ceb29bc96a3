// The records of a store, and the interface of a store.
//
// open_sqlite_store() opens the one on a disk; StoreQueue (store_queue.h) queues for it. Tests and the soak use
// MemoryStore (lab/soak), which simulates full, failing and slow disks.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "algo/verdict/verdict.h"
#include "common/result.h"
#include "firmware/core/station_types.h"

namespace hord::firmware::store {

// Microseconds since 1970-01-01T00:00:00 UTC, by the machine's clock (which may be set).
using UtcMicros = std::int64_t;

// Both clocks at one moment.
struct ClockReading {
    UtcMicros utc_us = 0;
    std::int64_t steady_us = 0;  // monotonic, from any moment
};

// The station was started. Everything that follows belongs to this run.
struct StartRecord {
    UtcMicros time_us = 0;
    std::uint32_t boot = 0;  // the registers' boot_id
    std::string station;     // its name
    std::string software;    // version
};

// A change that affects the following results, a loss of results, or a command.
struct ChangeRecord {
    enum class What : std::uint8_t { recipe, configuration, calibration, lost, command };
    What what = What::recipe;
    UtcMicros time_us = 0;
    std::string peer;           // address of the client; empty: the station itself
    std::uint32_t token = 0;    // of the command
    std::string name;           // of the recipe, the configuration file or the command; lost: "results"
    std::string before, after;  // whole texts; command: the state before, and the outcome
    // For the state at a start: written only if `after` differs from the store's newest one, which becomes `before`.
    bool if_new = false;
};

struct ResultRecord {
    PartResult result;
    UtcMicros time_us = 0;              // of the part sensor's edge
    std::vector<algo::Defect> defects;  // largest peak first
};

// A PLC has acknowledged the results of this run up to `sequence`.
struct AcknowledgeRecord {
    UtcMicros time_us = 0;
    std::string peer;
    std::uint32_t sequence = 0;
};

using Record = std::variant<StartRecord, ChangeRecord, ResultRecord, AcknowledgeRecord>;

// `number` counts the records of a run from 1: a batch repeated after an error stores no record twice. 0: the run's
// start, and the changes in use at that time; stored only if the store does not have this run.
struct Entry {
    std::uint64_t number = 0;
    Record record;
};

std::string_view name_of(ChangeRecord::What what);

// How long results and commands are kept. Changes are never removed.
struct Retention {
    int keep_days = 0;            // older ones are removed, by the days that the clock has shown; 0: no limit
    std::uint64_t max_bytes = 0;  // of the store; beyond it the oldest are removed; 0: no limit
};

class ResultStore {
  public:
    virtual ~ResultStore() = default;

    // Blocks; one thread. When it returns, all of `entries` are durable, in order: they survive the process and a loss
    // of power. After a failure the store must not be used again: the batch may have been stored or not, and the next
    // store that is opened skips the entries it has. Fails with io (full, read-only, broken disk), unreadable
    // (damaged), busy, not_found (its files were moved or removed: what was durable is not where people look for it).
    // The first entry of a run is its StartRecord. Without entries it only checks that the files are there.
    virtual Result<void> write(std::span<const Entry> entries) = 0;

    // Removes rows beyond `retention`, a bounded number in one call, and enters in the changes what was removed and
    // why. True: there are more to remove. Call it every minute: ages are counted by what these calls see of the
    // clocks.
    virtual Result<bool> prune(const Retention& retention, const ClockReading& now) = 0;
};

}  // namespace hord::firmware::store
