// How far the results of a store have been handed over: a small file that outlives the process.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "common/result.h"

namespace hord::firmware::mqtt {

struct Cursor {
    std::string store;            // the store's id; another one begins anew
    std::int64_t origin = 0;      // results up to this number are none of ours: they are older than the first start
    std::int64_t confirmed = 0;   // every result from origin + 1 up to this number has been taken
    std::uint8_t bd_seq = 255;    // of the session before: the next one's is one more
    std::uint64_t lost = 0;       // results that retention removed before they were handed over
    std::int64_t lost_until = 0;  // up to this number these are counted
    bool operator==(const Cursor&) const = default;
};

// Empty: there is no such file yet. Fails with unreadable (damaged: nothing is guessed), io.
Result<std::optional<Cursor>> read_cursor(const std::filesystem::path& file);

// Durable when it returns; the old one stays whole on failure. Fails with io.
Result<void> write_cursor(const std::filesystem::path& file, const Cursor& cursor);

}  // namespace hord::firmware::mqtt
