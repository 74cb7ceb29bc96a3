// A store in memory with a scripted disk: for tests and simulated days. The disk holds one run and outlives the stores
// opened on it. One thread at a time.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "firmware/store/results/result_store.h"

namespace hord::firmware::store {

struct MemoryDisk {
    std::vector<Entry> entries;  // everything that is durable
    int opened = 0, batches = 0, pruned = 0;

    // Called before the operation; a returned error makes it fail. May be empty.
    std::function<std::optional<Error>()> on_open, on_write, on_prune;
    // Called when a batch is durable. With an error the writer does not know whether the batch is durable.
    std::function<std::optional<Error>()> on_written;
};

class MemoryStore final : public ResultStore {
  public:
    static Result<std::unique_ptr<ResultStore>> open(MemoryDisk& disk) {
        ++disk.opened;
        if (auto error = ask(disk.on_open)) return tl::unexpected(*error);
        return std::unique_ptr<ResultStore>(new MemoryStore(disk));
    }

    Result<void> write(std::span<const Entry> entries) override {
        if (entries.empty()) return {};
        if (auto error = ask(disk_.on_write)) return tl::unexpected(*error);
        ++disk_.batches;
        for (const Entry& entry : entries) {
            if (entry.number != 0 ? entry.number <= last_ : knows_the_run_) continue;
            disk_.entries.push_back(entry);
            last_ = std::max(last_, entry.number);
        }
        if (auto error = ask(disk_.on_written)) return tl::unexpected(*error);
        return {};
    }
    Result<bool> prune(const Retention&, const ClockReading&) override {
        if (auto error = ask(disk_.on_prune)) return tl::unexpected(*error);
        ++disk_.pruned;
        return false;
    }

  private:
    explicit MemoryStore(MemoryDisk& disk) : disk_(disk), knows_the_run_(!disk.entries.empty()) {
        for (const Entry& entry : disk_.entries) last_ = std::max(last_, entry.number);
    }
    static std::optional<Error> ask(const std::function<std::optional<Error>()>& what) {
        return what ? what() : std::nullopt;
    }

    MemoryDisk& disk_;
    const bool knows_the_run_;
    std::uint64_t last_ = 0;
};

}  // namespace hord::firmware::store
