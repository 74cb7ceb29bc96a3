// A ring of frames on a disk: the oldest are removed beyond a total size or below a free space of the disk.
//
// A file appears whole or not at all: it is written under another name, synced and renamed. Its name begins with a
// number that counts over restarts, so names sort by age even if the clock was set:
//     000000000123-20261121T071500Z-p42-reject.png
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <system_error>
#include <vector>

#include "common/result.h"

namespace hord::firmware::store {

constexpr const char* kFramesFolder = "frames";

struct ArchivedFile {
    std::uint64_t number = 0;
    std::filesystem::path file;
    std::uint64_t bytes = 0;
};

// The frames of an archive, oldest first; other files are skipped. Fails with not_found.
Result<std::vector<ArchivedFile>> list_frames(const std::filesystem::path& folder);

// Whether a station of this user can keep frames there; one that does not exist is made by the first frame. Fails with
// io: a file or a link to nothing is in its place, or it cannot be written.
Result<void> check_frames_folder(const std::filesystem::path& folder);

// The disk, replaceable in tests. Each blocks.
struct ArchiveDisk {
    std::function<std::error_code(const std::filesystem::path& folder)> make_folder;  // unless it exists
    // All files of the archive, and none of those that were not finished: they are removed.
    std::function<Result<std::vector<ArchivedFile>>(const std::filesystem::path& folder)> list;
    std::function<std::error_code(const std::filesystem::path& file)> remove;  // no error if there is none
    std::function<Result<std::uint64_t>(const std::filesystem::path& folder)> free_bytes;
    // Durable when it returns; on failure the file does not exist.
    std::function<Result<void>(const std::filesystem::path& file, std::span<const std::uint8_t> bytes)> write;
};
ArchiveDisk real_disk();

struct ArchiveLimits {
    std::uint64_t max_bytes = 4'000'000'000;       // of all frames together
    std::uint64_t min_free_bytes = 1'000'000'000;  // of the disk, for results and other programs
};

class FrameArchive {
  public:
    // Creates the folder (not its parents), removes unfinished files. Blocks. Fails with io.
    static Result<std::unique_ptr<FrameArchive>> open(const std::filesystem::path& folder, const ArchiveLimits& limits,
                                                      ArchiveDisk disk = real_disk());

    [[nodiscard]] std::uint64_t next_number() const { return next_; }

    // Stores under next_number(), followed by `label`. Fails with io (no room even without other frames; read-only;
    // broken disk).
    Result<void> add(const std::string& label, std::span<const std::uint8_t> bytes);

    // Removes the oldest until the limits hold; other programs fill the disk, too. Fails with io when none is left.
    Result<void> trim() { return make_room(0); }

    // Leaves `bytes` more of the disk free than it has now, from now on: removes the oldest, and adds nothing before
    // there is room. Fails as trim().
    Result<void> leave_more_free(std::uint64_t bytes);

    // Whether a frame of so many bytes could be added: makes room, writes a file of that size and removes it. Fails as
    // add().
    Result<void> probe(std::uint64_t bytes);

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
    std::uint64_t for_results_ = 0;  // of the disk, asked for by leave_more_free()
};

}  // namespace hord::firmware::store
