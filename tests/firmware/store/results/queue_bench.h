// A queue of results over a disk in memory, without its thread, and what the disk holds after it.
#pragma once

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "firmware/store/results/store_queue.h"
#include "lab/soak/memory_store.h"
#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::store::test {

inline Error full() { return {ErrorCode::io, "results.db cannot grow: the disk is full", "free space"}; }

inline std::vector<std::uint32_t> sequences(const MemoryDisk& disk) {
    std::vector<std::uint32_t> all;
    for (const Entry& entry : disk.entries) {
        if (const auto* r = std::get_if<ResultRecord>(&entry.record)) all.push_back(r->result.sequence);
    }
    return all;
}
inline std::vector<std::string> lost(const MemoryDisk& disk) {
    std::vector<std::string> all;
    for (const Entry& entry : disk.entries) {
        const auto* change = std::get_if<ChangeRecord>(&entry.record);
        if (change != nullptr && change->what == ChangeRecord::What::lost) all.push_back(change->after);
    }
    return all;
}
inline std::vector<std::uint32_t> count_to(std::uint32_t last) {
    std::vector<std::uint32_t> all(last);
    for (std::uint32_t k = 0; k < last; ++k) all[k] = k + 1;
    return all;
}

// A queue without a thread over a disk in memory.
struct Bench {
    explicit Bench(StoreQueueOptions options = {})
        : queue([this] { return MemoryStore::open(disk); }, without_thread(options), start(), [] { return kNoon; },
                listener()) {}
    static StoreQueueOptions without_thread(StoreQueueOptions options) {
        options.thread = false;
        return options;
    }
    StoreQueue::Listener listener() {
        return {[this](const Error& error) { said.push_back(error.message()); },
                [this] { said.emplace_back("works again"); }};
    }
    void add(std::uint32_t from, std::uint32_t to) {
        for (std::uint32_t k = from; k <= to; ++k) queue.add(result(k));
    }
    MemoryDisk disk;
    std::vector<std::string> said;
    StoreQueue queue;
};

}  // namespace hord::firmware::store::test
