// Keeps frames: those of parts that did not pass, some before and after each of them, and samples.
//
// on_inspection() copies the frame into one of a fixed number of buffers and never waits for the disk; a thread encodes
// PNGs and adds them to the archive. When the disk is too slow, frames are dropped and counted; verdicts and results
// are not affected.
//
// frame_metadata.h says what is kept with a frame.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "algo/inspection/pipeline.h"
#include "firmware/core/station_types.h"
#include "firmware/store/frames/frame_archive.h"
#include "firmware/store/results/result_store.h"

namespace hord::firmware::store {

struct FrameRetentionOptions {
    algo::Extents extents = {};
    std::string station = {}, software = {};
    std::uint32_t boot = 0;
    int before = 2, after = 2;       // parts around one that did not pass
    std::uint32_t sample_every = 0;  // parts; 0: no samples
    std::size_t buffers = 24;        // each of one frame and its maps
    bool thread = true;              // false: only step() writes
    // Without new frames, too: other programs fill the disk, and free it.
    std::chrono::milliseconds look_every{10'000};
};

class FrameRetention {
  public:
    using Open = std::function<Result<std::unique_ptr<FrameArchive>>()>;
    // Called on the writing thread or an inspection thread.
    struct Listener {
        std::function<void(const Error&)> failed;  // frames are dropped; called once a failure
        std::function<void()> works_again;
    };

    FrameRetention(Open open, FrameRetentionOptions options, std::function<UtcMicros()> utc_now,
                   Listener listener = {});
    ~FrameRetention();  // finishes

    // Ends the thread. Writes the waiting frames if the disk works; if it did not, looks whether it does now. Returns
    // how many of them it had to drop; if the disk still takes none, all that were dropped since the start.
    std::uint64_t finish();

    // Any thread. The text of the recipe in use from now on.
    void set_recipe(const std::string& text);

    // Any thread; copies the frame.
    void on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection);

    // Any thread. A part whose inspection passed but that is rejected (verdict too late) counts as not passed.
    void on_result(const PartResult& result);

    struct Counts {
        std::uint64_t kept = 0, dropped = 0;  // since the start
        bool failing = false;
    };
    [[nodiscard]] Counts counts() const;

    // Any thread; does not wait for the disk. The store's disk is full: the oldest frames are removed, kRoomForResults
    // more of it stay free from now on, and no frame is written before.
    void make_room_for_results();
    static constexpr std::uint64_t kRoomForResults = 1'000'000;  // bytes at each call

    // Without a thread: makes room, writes one frame. False: neither was to be done.
    bool step();

  private:
    struct Buffer;
    using Handle = std::unique_ptr<Buffer>;
    void work(const std::stop_token& stop);
    void write(Buffer& buffer);
    void look_at_disk();
    void works_again(std::unique_lock<std::mutex>& lock);
    Result<void> use_archive();
    void trigger(std::uint32_t part, Handle buffer);
    void enqueue(Handle buffer, const char* role, std::uint32_t trigger);
    void drop(std::unique_lock<std::mutex>& lock, const Error& error);
    [[nodiscard]] std::string metadata_of(const Buffer& buffer) const;

    const Open open_;
    const FrameRetentionOptions options_;
    const std::function<UtcMicros()> utc_now_;
    const Listener listener_;
    // Used by the writing thread only.
    std::unique_ptr<FrameArchive> archive_;
    std::uint64_t refused_bytes_ = 0;  // of the last frame that the disk did not take

    mutable std::mutex mutex_;  // guards the rest
    std::condition_variable_any wake_;
    std::vector<Handle> free_;
    std::deque<Handle> recent_;         // passed and not kept so far, newest last
    std::deque<Handle> waiting_;        // to be written
    std::deque<std::uint32_t> missed_;  // rejected parts whose frame has not come yet
    std::shared_ptr<const std::string> recipe_ = std::make_shared<std::string>();
    int after_ = 0;
    bool results_need_room_ = false;
    std::uint32_t trigger_ = 0;
    Counts counts_;
    std::jthread thread_;
};

}  // namespace hord::firmware::store
