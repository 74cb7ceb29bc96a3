#include "firmware/page/kept_frames.h"

#include <algorithm>
#include <cerrno>
#include <cinttypes>
#include <cstdio>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/store/frames/frame_archive.h"

namespace hord::firmware::page {
namespace {

namespace fs = std::filesystem;
constexpr int kMaxCandidates = 8;  // frames of equal part numbers from different starts

// "000000000123-20261121T071500Z-p42-reject.png"
std::optional<std::pair<std::uint64_t, std::uint32_t>> number_and_part_of(const std::string& name) {
    std::uint64_t number = 0;
    std::uint32_t part = 0;
    int used = 0;
    std::sscanf(name.c_str(), "%12" SCNu64 "-%*16[0-9TZ]-p%" SCNu32 "-%n", &number, &part, &used);
    if (used == 0 || name[12] != '-' || !name.ends_with(".png")) return std::nullopt;
    return std::pair{number, part};
}

}  // namespace

// With the lock. Lists the folder when its modification time has changed, and spends at most a tenth of the time on it.
void KeptFrames::refresh() {
    const auto now = std::chrono::steady_clock::now();
    if (now < next_refresh_) return;
    std::error_code error;
    const auto changed = fs::last_write_time(folder_, error);
    if (error) {
        files_.clear();
        return;
    }
    // The modification time has a limited resolution: a second change soon after may not show.
    const bool settled = fs::file_time_type::clock::now() - changed > std::chrono::seconds(2);
    if (changed == changed_ && settled && !files_.empty()) return;
    std::vector<ListedFile> found;
    for (fs::directory_iterator entry(folder_, error); !error && entry != fs::directory_iterator();
         entry.increment(error)) {
        std::string name = entry->path().filename().string();
        if (const auto is = number_and_part_of(name)) found.push_back({is->first, is->second, std::move(name)});
        if (found.size() >= 2 * kMaxFiles) {  // drop the oldest half
            std::nth_element(found.begin(), found.begin() + kMaxFiles, found.end(),
                             [](const ListedFile& a, const ListedFile& b) { return a.number > b.number; });
            found.resize(kMaxFiles);
        }
    }
    std::sort(found.begin(), found.end(), [](const ListedFile& a, const ListedFile& b) { return a.number < b.number; });
    if (found.size() > kMaxFiles) found.erase(found.begin(), found.end() - kMaxFiles);
    files_ = std::move(found);
    changed_ = changed;
    const auto took = std::chrono::steady_clock::now() - now;
    next_refresh_ = now + took * 10 + std::chrono::milliseconds(30);
}

Result<KeptFrame> KeptFrames::read(const std::string& name) const {
    const fs::path file = folder_ / name;
    KeptFrame kept;
    kept.name = name;
    kept.file.reset(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    if (!kept.file && errno == ENOENT)
        return fail(ErrorCode::not_found, name + " is no longer kept",
                    "the ring of pictures has made room for newer ones");
    struct stat what {};
    const bool regular = kept.file && ::fstat(kept.file.get(), &what) == 0 && S_ISREG(what.st_mode);
    if (regular && std::cmp_greater(what.st_size, kLargestFile))
        return fail(ErrorCode::unreadable, name + " is too large for a frame", "see the store's folder");
    kept.file_size = regular ? static_cast<std::size_t>(what.st_size) : 0;
    std::vector<std::uint8_t> bytes(kept.file_size);
    if (!regular || ::pread(kept.file.get(), bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
        return fail(ErrorCode::io, name + " cannot be read", "check the rights of the page's user, and the disk");
    auto frame = store::decode_png(bytes, name);
    if (!frame) return tl::unexpected(frame.error());
    kept.frame = std::move(*frame);
    auto metadata = store::FrameMetadata::from_json(kept.frame.metadata, name);
    if (!metadata) return tl::unexpected(metadata.error());
    kept.metadata = std::move(*metadata);
    return kept;
}

Result<KeptFrame> KeptFrames::find(std::uint32_t boot, std::uint32_t part) {
    std::vector<std::string> names;
    {
        const std::lock_guard lock(mutex_);
        refresh();
        for (auto at = files_.rbegin(); at != files_.rend() && names.size() < kMaxCandidates; ++at) {
            if (at->part == part) names.push_back(at->name);
        }
    }
    std::optional<Error> torn;
    for (const std::string& name : names) {
        auto kept = read(name);
        if (!kept) {
            if (kept.error().code != ErrorCode::not_found) torn = kept.error();
            continue;
        }
        if (kept->metadata.boot == boot && kept->metadata.part == part) return kept;
    }
    if (torn) return tl::unexpected(*torn);
    return fail(ErrorCode::not_found, fmt::format("no frame of part {} is kept", part),
                "frames are kept of parts that did not pass, of some around them, and of samples, while there is room");
}

std::optional<KeptFrame> KeptFrames::newest() { return newest(".png", last_newest_); }
std::optional<KeptFrame> KeptFrames::newest_reject() { return newest("-reject.png", last_reject_); }

std::optional<KeptFrame> KeptFrames::newest(std::string_view ending, std::string& last) {
    std::string name;
    {
        const std::lock_guard lock(mutex_);
        refresh();
        const auto found = std::find_if(files_.rbegin(), files_.rend(), [&](const ListedFile& k) {
            return std::string_view(k.name).ends_with(ending);
        });
        if (found == files_.rend() || found->name == last) return std::nullopt;
        name = last = found->name;
    }
    auto kept = read(name);
    if (!kept) return std::nullopt;
    return std::move(*kept);
}

}  // namespace hord::firmware::page
