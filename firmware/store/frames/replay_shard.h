// The results of one shard of a replay as a file; the shards of one replay, from any machine, are merged into one.
//
//     {"hord_replay":1,"archive":SHA-256,"frames":1000,"recipe":"own","software":"0.1.0","program":SHA-256,
//      "shard":"2/4"}, in one line
//     one line a frame (replay.h), in the order of their names; or {"frame":...,"unreadable":"..."}
//     {"records":250,"same":249,"verdicts":1,"unreadable":0,"sha256":SHA-256 of everything before this line}
//
// A file appears whole or not at all. The same archive, recipe and program give the same bytes, and merged shards are
// the same bytes as one replay of the whole archive.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/result.h"
#include "common/unique_fd.h"
#include "firmware/store/frames/frame_archive.h"
#include "firmware/store/frames/replay_run.h"
#include "firmware/store/results/hash_chain.h"

namespace hord::firmware::store {

// Two shards belong to one replay if this is equal.
struct ReplayIdentity {
    std::string archive;       // SHA-256 over the names and sizes of all its frames
    std::uint64_t frames = 0;  // of the whole archive
    std::string recipe;        // SHA-256 of its text; "own": each frame was judged with its own
    std::string software;      // version
    std::string program;       // SHA-256 of the program's file
    bool operator==(const ReplayIdentity&) const = default;
};

std::string archive_identity(const std::vector<ArchivedFile>& frames);  // in order (put_in_order)
std::string text_identity(std::string_view text);
Result<std::string> program_identity();  // of the running program. Fails with io

struct ReplayTally {
    std::uint64_t records = 0, same = 0, verdicts = 0, unreadable = 0;  // verdicts: those that change
    bool operator==(const ReplayTally&) const = default;
};

class ShardWriter {
  public:
    // Writes to a temporary file beside `file`. Fails with io.
    static Result<ShardWriter> create(const std::filesystem::path& file, const ReplayIdentity& identity,
                                      const Shard& shard);
    ShardWriter(ShardWriter&&) = default;
    ShardWriter& operator=(ShardWriter&&) = delete;
    ~ShardWriter();  // unfinished: nothing is left

    Result<void> add(std::string_view line);  // without its end
    Result<ReplayTally> finish();             // durable, under its name

  private:
    explicit ShardWriter(std::filesystem::path file) : file_(std::move(file)) {}
    [[nodiscard]] tl::unexpected<Error> failed(int why) const;
    Result<void> write(std::string_view line);
    Result<void> flush();

    std::filesystem::path file_;
    std::string beside_;  // the temporary file
    common::UniqueFd fd_;
    std::string waiting_;  // not written yet
    Sha256 sum_;           // of what was written
    ReplayTally tally_;
};

// The line of a frame that cannot be replayed.
std::string unreadable_line(const std::string& frame, ErrorCode why);

// Merges all shards of one replay, in any order, into one file. Checks every byte. Fails with not_found, unreadable
// (not a shard, truncated, changed), invalid_argument (missing, repeated, of another replay), io; writes nothing then.
Result<ReplayTally> merge_shards(const std::vector<std::filesystem::path>& files, const std::filesystem::path& out);

}  // namespace hord::firmware::store
