// Read access to the archive of frames: finds the frame of a part. Frames may be removed meanwhile. Any thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/result.h"
#include "common/unique_fd.h"
#include "firmware/store/frames/frame_metadata.h"
#include "firmware/store/frames/frame_png.h"

namespace hord::firmware::page {

struct KeptFrame {
    std::string name;  // of its file
    common::UniqueFd file;
    std::size_t file_size = 0;
    store::AnnotatedFrame frame;
    store::FrameMetadata metadata;
};

class KeptFrames {
  public:
    static constexpr std::size_t kMaxFiles = 200'000;  // older ones are ignored
    static constexpr std::uintmax_t kLargestFile = 64 * 1024 * 1024;

    explicit KeptFrames(std::filesystem::path folder) : folder_(std::move(folder)) {}

    // The frame of `part` since the station's start `boot`. Fails with not_found, unreadable (damaged), io.
    Result<KeptFrame> find(std::uint32_t boot, std::uint32_t part);

    // The newest frame, of any part or of a rejected one. Empty if it is the one of the last call, or there is none.
    std::optional<KeptFrame> newest();
    std::optional<KeptFrame> newest_reject();

  private:
    struct ListedFile {
        std::uint64_t number;
        std::uint32_t part;
        std::string name;
    };
    void refresh();
    std::optional<KeptFrame> newest(std::string_view ending, std::string& last);
    Result<KeptFrame> read(const std::string& name) const;

    const std::filesystem::path folder_;
    std::mutex mutex_;
    std::vector<ListedFile> files_;  // by number
    std::filesystem::file_time_type changed_{};
    std::chrono::steady_clock::time_point next_refresh_{};
    std::string last_newest_, last_reject_;
};

}  // namespace hord::firmware::page
