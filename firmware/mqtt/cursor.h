// How far the results of a store have been delivered: a small file that survives the process.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "common/result.h"
#include "common/unique_fd.h"

namespace hord::firmware::mqtt {

struct Cursor {
    std::string store;            // the store's id; with another id the delivery begins again
    std::int64_t origin = 0;      // results up to this number are older than the first start and not delivered
    std::int64_t confirmed = 0;   // every result from origin + 1 to this number is delivered
    std::uint8_t bd_seq = 255;    // of the last session; the next one's is one more
    std::uint64_t lost = 0;       // results that retention removed before delivery
    std::int64_t lost_until = 0;  // lost results are counted up to this number
    bool operator==(const Cursor&) const = default;
};

// Keeps other processes off the cursor until it is destroyed, by a lock (flock) on FILE.lock. Fails with busy if
// another one holds it. Nothing is held, without an error, where that file cannot be opened: writing the cursor tells
// why.
Result<common::UniqueFd> lock_cursor(const std::filesystem::path& file);

// Empty: no such file. Fails with unreadable (damaged), io.
Result<std::optional<Cursor>> read_cursor(const std::filesystem::path& file);

// Durable when it returns; a failure keeps the old file. Fails with io.
Result<void> write_cursor(const std::filesystem::path& file, const Cursor& cursor);

}  // namespace hord::firmware::mqtt
