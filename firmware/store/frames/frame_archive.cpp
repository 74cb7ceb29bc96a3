#include "firmware/store/frames/frame_archive.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <random>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "common/dangling_link.h"
#include "common/file_writing.h"
#include "common/regular_file.h"
#include "firmware/store/results/sqlite_store.h"
#include "firmware/store/results/store_rights.h"

namespace hord::firmware::store {
namespace {

namespace fs = std::filesystem;

constexpr const char* kUnfinished = ".part";
constexpr const char* kProbe = "probe.png.part";  // an unfinished file: open() removes what a killed process left

double in_mb(std::uint64_t bytes) { return static_cast<double>(bytes) / 1e6; }

// The number at the beginning of a frame's name; 0: not a frame of an archive.
std::uint64_t number_of(const fs::path& file) {
    const std::string name = file.filename().string();
    std::uint64_t number = 0;
    const auto read = std::from_chars(name.data(), name.data() + name.size(), number);
    const bool ours = read.ec == std::errc() && read.ptr == name.data() + 12 && name.size() > 13 && name[12] == '-' &&
        file.extension() == ".png";
    return ours ? number : 0;
}

tl::unexpected<Error> folder_gone(const fs::path& folder, int why) {
    return fail(
        ErrorCode::io,
        "the folder " + folder.string() + " is gone" +
            (why == ENOTDIR ? ": a file is in its place, or in that of one above it" : " (something removed it)"),
        why == ENOTDIR ? "move that file away, create the folder and give it to the station's user"
                       : "create it and give it to the station's user");
}

Result<void> write_synced(const fs::path& file, std::span<const std::uint8_t> bytes) {
    const int why = common::replace_file(file, kUnfinished, 0644, true, std::as_bytes(bytes));
    if (why == 0) return {};
    if (why == ENOTDIR || why == ENOENT) return folder_gone(file.parent_path(), why);
    return fail(ErrorCode::io, file.string() + " cannot be written (" + std::strerror(why) + ")",
                why == ENOSPC || why == EDQUOT ? "free space on its disk, or lower store.frames_mb"
                                               : "check the folder's permissions and the disk");
}

Result<std::uint64_t> free_bytes(const fs::path& folder) {
    struct statvfs space {};
    if (statvfs(folder.c_str(), &space) != 0) {
        if (errno == ENOTDIR || errno == ENOENT) return folder_gone(folder, errno);
        return fail(ErrorCode::io, "the disk of " + folder.string() + " does not answer (" + std::strerror(errno) + ")",
                    "check the disk");
    }
    return static_cast<std::uint64_t>(space.f_bavail) * space.f_frsize;
}

std::error_code remove_file(const fs::path& file) {
    std::error_code error;
    fs::remove(file, error);
    return error;
}

tl::unexpected<Error> cannot_remove(const fs::path& file, const std::error_code& error) {
    return fail(ErrorCode::io, file.string() + " cannot be removed (" + error.message() + ")",
                "check the folder's permissions and the disk");
}

// Calls `take` for every entry. Does not throw, unlike a range-based for.
std::error_code each_entry(const fs::path& folder, const std::function<void(const fs::directory_entry&)>& take) {
    std::error_code error;
    for (fs::directory_iterator entry(folder, error); !error && entry != fs::directory_iterator();
         entry.increment(error))
        take(*entry);
    return error;
}

Result<std::vector<ArchivedFile>> list_finished(const fs::path& folder) {
    std::vector<fs::path> unfinished;
    const std::error_code error = each_entry(folder, [&](const fs::directory_entry& entry) {
        const std::string name = entry.path().string();
        if (name.ends_with(kUnfinished) && name.find(".png.") != std::string::npos) unfinished.push_back(name);
    });
    if (!error) {
        for (const fs::path& file : unfinished) (void)remove_file(file);
    }
    return list_frames(folder);
}

}  // namespace

ArchiveDisk real_disk() { return {common::ensure_folder, list_finished, remove_file, free_bytes, write_synced}; }

Result<std::vector<ArchivedFile>> list_frames(const fs::path& folder) {
    std::vector<ArchivedFile> files;
    const std::error_code error = each_entry(folder, [&](const fs::directory_entry& entry) {
        const std::uint64_t number = number_of(entry.path());
        if (number == 0) return;
        std::error_code removed;  // the file was removed meanwhile
        const std::uint64_t bytes = entry.file_size(removed);
        if (!removed) files.push_back({number, entry.path(), bytes});
    });
    if (error)
        return fail(ErrorCode::not_found, folder.string() + " cannot be read (" + error.message() + ")",
                    "name the folder of a station's store");
    std::sort(files.begin(), files.end(),
              [](const ArchivedFile& a, const ArchivedFile& b) { return a.file.filename() < b.file.filename(); });
    return files;
}

Result<void> check_frames_folder(const fs::path& folder) {
    std::error_code error;
    if (const std::string link = common::dangling_link(folder); !link.empty())
        return fail(ErrorCode::io, link, "make the folder that it leads to or mount its disk, or remove the link");
    const fs::file_type type = fs::status(folder, error).type();
    if (type == fs::file_type::not_found || error) return {};
    if (type != fs::file_type::directory) {
        const char* const what = common::name_of_irregular(type);
        return fail(ErrorCode::io, fmt::format("{} is {}, not a folder", folder.string(), what ? what : "a file"),
                    "move it away: the station makes the folder");
    }
    if (::faccessat(AT_FDCWD, folder.c_str(), W_OK | X_OK, AT_EACCESS) == 0) return {};
    return fail(ErrorCode::io, fmt::format("{} cannot be written ({})", folder.string(), std::strerror(errno)),
                rights_cure(folder.parent_path()));
}

Result<std::unique_ptr<FrameArchive>> FrameArchive::open(const fs::path& folder, const ArchiveLimits& limits,
                                                         ArchiveDisk disk) {
    if (const std::error_code error = disk.make_folder(folder)) {
        return folder_unusable(folder, error);
    }
    std::unique_ptr<FrameArchive> archive(new FrameArchive(folder, limits, std::move(disk)));
    auto files = archive->disk_.list(folder);
    if (!files) return tl::unexpected(files.error());
    archive->files_.assign(files->begin(), files->end());
    for (const ArchivedFile& file : archive->files_) {
        archive->bytes_ += file.bytes;
        archive->next_ = std::max(archive->next_, file.number + 1);
    }
    return archive;
}

Result<void> FrameArchive::add(const std::string& label, std::span<const std::uint8_t> bytes) {
    if (auto room = make_room(bytes.size()); !room) return room;
    const fs::path file = folder_ / fmt::format("{:012}-{}.png", next_, label);
    if (auto written = disk_.write(file, bytes); !written) return written;
    files_.push_back({next_++, file, bytes.size()});
    bytes_ += bytes.size();
    return {};
}

Result<void> FrameArchive::probe(std::uint64_t bytes) {
    if (auto room = make_room(bytes); !room) return room;
    const fs::path file = folder_ / kProbe;
    // Noise: zeros take no room on a disk that compresses.
    std::vector<std::uint8_t> noise(bytes);
    std::ranges::generate(noise,
                          [random = std::minstd_rand()]() mutable { return std::uint8_t(random() >> 8 & 0xFFU); });
    if (auto written = disk_.write(file, noise); !written) return written;
    if (const std::error_code error = disk_.remove(file)) return cannot_remove(file, error);
    return {};
}

Result<void> FrameArchive::make_room(std::uint64_t bytes) {
    if (bytes > limits_.max_bytes) {
        return fail(ErrorCode::io, fmt::format("a frame of {} bytes is larger than all frames together may be", bytes),
                    "raise store.frames_mb");
    }
    while (bytes_ + bytes > limits_.max_bytes) {
        if (auto removed = remove_oldest(); !removed) return removed;
    }
    while (true) {
        const auto left = disk_.free_bytes(folder_);
        if (!left) return tl::unexpected(left.error());
        const std::uint64_t stays = std::max(limits_.min_free_bytes, for_results_);
        if (*left >= stays + bytes) return {};
        if (files_.empty()) {
            const bool results = for_results_ > limits_.min_free_bytes;
            return fail(
                ErrorCode::io,
                fmt::format("the disk of {} has {:.1f} MB left, and {:.1f} MB are to stay free{}", folder_.string(),
                            in_mb(*left), in_mb(stays), results ? " for results: it was full" : ""),
                results ? "free space on it" : "free space on it, or lower store.free_mb");
        }
        if (auto removed = remove_oldest(); !removed) return removed;
    }
}

Result<void> FrameArchive::leave_more_free(std::uint64_t bytes) {
    const auto left = disk_.free_bytes(folder_);
    if (!left) return tl::unexpected(left.error());
    // Without a frame to remove, a higher limit would only keep later ones off a disk that others have filled.
    if (!files_.empty()) for_results_ = std::max(for_results_, *left + bytes);
    return trim();
}

Result<void> FrameArchive::remove_oldest() {
    const ArchivedFile& oldest = files_.front();
    if (const std::error_code error = disk_.remove(oldest.file)) return cannot_remove(oldest.file, error);
    bytes_ -= oldest.bytes;
    files_.pop_front();
    return {};
}

}  // namespace hord::firmware::store
