// A sensor that plays recorded frames: one file a trigger, sorted by name.
//
// open() reads and checks all files and keeps them in memory: a bad file is refused before the line runs, and a trigger
// does not read a file. Leases refer to that memory without a copy.
#pragma once

#include <atomic>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "drivers/files/frame_file.h"
#include "drivers/hal/event_loop.h"
#include "drivers/hal/sensor.h"

namespace hord::drivers {

struct RecordedFramesOptions {
    ExpectedFrame expected;                                // 0: as in the first file; all others must be the same
    int buffers = 4;                                       // frames that can be leased at the same time
    hal::Duration readout = std::chrono::milliseconds(1);  // from the end of the exposure to delivery
    bool repeat = false;  // starts again after the last file; else the device is lost then
};

class RecordedFrames final : public hal::Sensor {
  public:
    // Loop thread; blocks while it reads. Folders as in list_frames(). Fails with not_found (no such file or folder, no
    // frame in it), invalid_argument (buffers < 1, frames of different formats), or as read_frame() does; names every
    // bad file.
    static Result<std::unique_ptr<RecordedFrames>> open(hal::EventLoop& loop,
                                                        const std::vector<std::filesystem::path>& files_or_folders,
                                                        const RecordedFramesOptions& options = {});
    ~RecordedFrames() override { stop(); }

    [[nodiscard]] std::size_t count() const { return frames_.size(); }
    // The file of the frame with this sequence number (from 1, since start).
    [[nodiscard]] const std::filesystem::path& file_of(std::uint32_t sequence) const {
        return files_[(sequence - 1) % files_.size()];
    }

  private:
    enum class State : std::uint8_t { free, exposing, lent };
    struct Slot {
        std::atomic<State> state{State::free};
        hal::FrameInfo info;
        hal::EventLoop::TimerId timer{};
    };
    RecordedFrames(hal::EventLoop& loop, const RecordedFramesOptions& options);
    [[nodiscard]] hal::SensorFormat do_format() const override;
    Result<void> do_start(Listener& listener) override;
    Result<void> do_trigger(const hal::ExposureRequest& request) override;
    void do_stop() override;
    void do_give_back(std::uint32_t slot) noexcept override {
        slots_[slot].state.store(State::free, std::memory_order_release);
    }
    void deliver(std::uint32_t slot);
    [[nodiscard]] Error used_up() const;

    hal::EventLoop& loop_;
    RecordedFramesOptions options_;
    std::vector<std::filesystem::path> files_;
    std::vector<Frame> frames_;
    std::unique_ptr<Slot[]> slots_;
    Listener* listener_ = nullptr;
    std::uint32_t sequence_ = 0;
    bool lost_ = false;
    hal::EventLoop::TimerId lost_timer_{};
};

}  // namespace hord::drivers
