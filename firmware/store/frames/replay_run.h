// Replays many frames on several threads. The results and their order do not depend on the number of threads.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "algo/recipe/recipe.h"
#include "common/result.h"
#include "firmware/store/frames/frame_archive.h"
#include "firmware/store/frames/replay.h"

namespace hord::firmware::store {

// One of `count` parts of an archive, index from 1. A frame's shard follows from its number, or without one from the
// CRC-32 of its name, never from other frames.
struct Shard {
    std::uint64_t index = 1, count = 1;
    bool operator==(const Shard&) const = default;
    [[nodiscard]] bool holds(const ArchivedFile& frame) const;
    [[nodiscard]] std::string text() const;  // "2/4"
};
constexpr std::uint64_t kMaxShards = 100'000;

// "2/4"; nothing else. Fails with invalid_argument.
Result<Shard> parse_shard(std::string_view text);

// The file's name as it stands in a line of a replay: JSON, without the quotes around it.
std::string written_name(const ArchivedFile& frame);

// Sorts the frames by written_name, the order in which they are judged and written. Fails with invalid_argument when
// two have the same name.
Result<void> put_in_order(std::vector<ArchivedFile>& frames);

// Replays `frames` with `jobs` threads and calls `take` on this thread, in order; at most 64 results a thread wait.
// `take` returns false to stop. Without a recipe each frame is inspected with its own.
void replay_all(const std::vector<ArchivedFile>& frames, const std::optional<algo::Recipe>& recipe, unsigned jobs,
                const std::function<bool(const ArchivedFile&, Result<Replayed>)>& take);

}  // namespace hord::firmware::store
