// A Sensor that plays recorded frames: one file a trigger, in the order of the names.
//
// All files are read and checked by open(), so that a bad one is refused before the line runs and a trigger costs
// nothing; they stay in memory. A lease reads that memory: nothing is copied.
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
    ExpectedFrame expected;                                // 0: what the first file has; all others must have the same
    int buffers = 4;                                       // frames that may be lent at the same time
    hal::Duration readout = std::chrono::milliseconds(1);  // end of the exposure to delivery
    bool repeat = false;  // after the last file the first comes again; else the device is lost
};

class RecordedFrames final : public hal::Sensor {
  public:
    // Loop thread; blocks while it reads. A folder stands for its PNG, TIFF and PGM files (.png .tif .tiff .pgm),
    // sorted by name; everything else in it is left alone. Fails with not_found (no such file or folder, no frame in
    // it), invalid_argument (buffers < 1, frames of different formats), or as read_frame() does; every bad file is
    // named.
    static Result<std::unique_ptr<RecordedFrames>> open(hal::EventLoop& loop,
                                                        const std::vector<std::filesystem::path>& files_or_folders,
                                                        const RecordedFramesOptions& options = {});
    ~RecordedFrames() override { stop(); }

    [[nodiscard]] std::size_t count() const { return frames_.size(); }
    // The file that the frame of this sequence (from 1, since start) was read from.
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
