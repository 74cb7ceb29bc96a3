// A ring of frames on a disk: the oldest make room, by bytes and by what the disk has left.
//
// A file appears whole or not at all: it is written beside, synced and renamed. Its name begins with a number that
// counts over restarts, so that names sort by age whatever the clock did:
//     000000000123-20261121T071500Z-p42-reject.png
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/result.h"

namespace hord::firmware::store {

constexpr const char* kFramesFolder = "frames";

struct ArchivedFile {
    std::uint64_t number = 0;
    std::filesystem::path file;
    std::uint64_t bytes = 0;
};

// The frames of an archive, oldest first; anything else in the folder is left out. Fails with not_found.
Result<std::vector<ArchivedFile>> list_frames(const std::filesystem::path& folder);

// The disk, replaceable in tests. Each blocks.
struct ArchiveDisk {
    std::function<Result<std::uint64_t>(const std::filesystem::path& folder)> free_bytes;
    // Durable when it returns; on failure the file does not exist.
    std::function<Result<void>(const std::filesystem::path& file, std::span<const std::uint8_t> bytes)> write;
};
ArchiveDisk real_disk();

struct ArchiveLimits {
    std::uint64_t max_bytes = 4'000'000'000;       // of all frames together
    std::uint64_t min_free_bytes = 1'000'000'000;  // what the disk keeps, for results and for others
};

class FrameArchive {
  public:
    // Makes the folder (not its parents), removes what was left unfinished. Blocks. Fails with io.
    static Result<std::unique_ptr<FrameArchive>> open(const std::filesystem::path& folder, const ArchiveLimits& limits,
                                                      ArchiveDisk disk = real_disk());

    [[nodiscard]] std::uint64_t next_number() const { return next_; }

    // Stores under next_number(); `label` follows it in the name. Fails with io (no room, however much was removed;
    // read-only; broken disk).
    Result<void> add(const std::string& label, std::span<const std::uint8_t> bytes);

    // Removes the oldest until the limits hold: others use the disk, too. Fails with io when nothing is left to remove.
    Result<void> trim() { return make_room(0); }

    [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
    [[nodiscard]] std::size_t count() const { return files_.size(); }

  private:
    FrameArchive(std::filesystem::path folder, const ArchiveLimits& limits, ArchiveDisk disk)
        : folder_(std::move(folder)), limits_(limits), disk_(std::move(disk)) {}
    Result<void> make_room(std::uint64_t bytes);
    Result<void> remove_oldest();

    const std::filesystem::path folder_;
    const ArchiveLimits limits_;
    const ArchiveDisk disk_;
    std::deque<ArchivedFile> files_;
    std::uint64_t bytes_ = 0, next_ = 1;
};

}  // namespace hord::firmware::store
