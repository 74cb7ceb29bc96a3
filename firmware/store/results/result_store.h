// What a store keeps, and the seam behind which it is kept.
//
// SqliteStore keeps it on a disk; StoreQueue (store_queue.h) stands between it and the line. Another implementation of
// ResultStore takes its place in tests and in the soak: full disks, errors and slow disks are scripted there.
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

// Microseconds since 1970-01-01T00:00:00 UTC, of the machine's clock at that moment (it may have been set since).
using UtcMicros = std::int64_t;

// The station was started. Everything that follows belongs to this run.
struct StartRecord {
    UtcMicros time_us = 0;
    std::uint32_t boot = 0;  // the registers' boot_id
    std::string station;     // its name
    std::string software;    // version
};

// What the results that follow were made with, and who changed it from what.
struct ChangeRecord {
    enum class What : std::uint8_t { recipe, configuration, calibration, lost };
    What what = What::recipe;
    UtcMicros time_us = 0;
    std::string peer;           // address that asked for it; empty: the station itself
    std::uint32_t token = 0;    // of the command
    std::string name;           // of the recipe, of the configuration's file; lost: of what
    std::string before, after;  // whole texts
    // Written only when `after` is not what the store knows already: what is in use when the station starts. `before`
    // is then what the store knew.
    bool if_new = false;
};

struct CommandRecord {
    UtcMicros time_us = 0;
    std::string peer;
    std::uint32_t token = 0;
    std::string name;
    std::string before, after;  // the state, and what came of it
};

struct ResultRecord {
    PartResult result;
    UtcMicros time_us = 0;              // of the part sensor's edge
    std::vector<algo::Defect> defects;  // largest peak first
};

// A PLC has taken the results up to `sequence` of this run.
struct AcknowledgeRecord {
    UtcMicros time_us = 0;
    std::string peer;
    std::uint32_t sequence = 0;
};

using Record = std::variant<StartRecord, ChangeRecord, CommandRecord, ResultRecord, AcknowledgeRecord>;

// `number` counts the records of a run from 1, so that a batch can be repeated after an error without anything being
// stored twice. 0: the run's start, and what was in use before the first entry that follows, stored where the store
// does not know the run.
struct Entry {
    std::uint64_t number = 0;
    Record record;
};

std::string_view name_of(ChangeRecord::What what);

// How long results and commands are kept; changes are kept for good.
struct Retention {
    std::int64_t keep_us = 0;     // older ones are removed; 0: no limit
    std::uint64_t max_bytes = 0;  // the oldest are removed until the store takes no more; 0: no limit
};

class ResultStore {
  public:
    virtual ~ResultStore() = default;

    // Blocks, on one thread. All of `entries`, in order, are durable when it returns: they outlive the process and a
    // loss of power. On failure the store must not be used again: whether the batch was stored is known only to the
    // next one that is opened, which leaves out what it has already. Fails with io (full, read-only, broken disk),
    // unreadable (damaged), busy. The first entry of a run is its StartRecord.
    Result<void> write(std::span<const Entry> entries) { return do_write(entries); }

    // Removes what is older or more than allowed, a bounded number of rows in one call. True: there is more to remove.
    Result<bool> prune(const Retention& retention, UtcMicros now_us) { return do_prune(retention, now_us); }

  private:
    virtual Result<void> do_write(std::span<const Entry> entries) = 0;
    virtual Result<bool> do_prune(const Retention& retention, UtcMicros now_us) = 0;
};

}  // namespace hord::firmware::store
