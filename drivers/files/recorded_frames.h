// A sensor that plays recorded frames: one file a trigger, sorted by name. After the last one the device is lost.
//
// open() reads and checks all files and keeps them in memory: a bad file is refused before the line runs, and a trigger
// does not read a file. Leases refer to that memory without a copy.
#pragma once

#include <array>
#include <atomic>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/files/frame_file.h"
#include "drivers/hal/event_loop.h"
#include "drivers/hal/sensor.h"

namespace hord::drivers {

// Reads recorded frames one after the other. All must be of one size, depth and geometry.
class RecordedSeries {
  public:
    // `bits`: of frames without a note; 0: as the files before it, else as its own file says.
    explicit RecordedSeries(int bits = 0) : bits_(bits) {}

    // The geometry that files of these frames note, the same in all of them, and the first such file.
    struct Noted {
        std::string file;
        FrameGeometry geometry;
    };

    // The next frame. Fails with invalid_argument (another format or geometry than the frames before it), or as
    // read_noted_frame() does. A frame that is refused changes nothing for those after it.
    Result<Frame> read(const std::filesystem::path& file);

    [[nodiscard]] const ExpectedFrame& format() const { return format_; }       // zeros: no frame has been read
    [[nodiscard]] const std::optional<Noted>& noted() const { return noted_; }  // none: no file has a note

  private:
    int bits_;
    ExpectedFrame format_;
    std::optional<Noted> noted_;
};

// The problems of several files, one a line: of more than kMaxFramesTold how many they are, and the first. Neighbours
// with one cure share it: it is said after the last of them. The last line is always a cure. Precondition: there is
// one.
inline constexpr std::size_t kMaxFramesTold = 10;
Error all_of(const std::vector<Error>& problems);

class RecordedFrames final : public hal::Sensor {
  public:
    static constexpr int kBuffers = 4;  // frames that can be leased at the same time
    static constexpr hal::Duration kReadout = std::chrono::milliseconds(1);  // from the exposure's end to delivery

    // Loop thread; blocks while it reads. Folders as in list_frames(). Fails with not_found (no such file or folder, no
    // frame in it), invalid_argument (frames of different formats or geometries), or as read_noted_frame() does; names
    // every bad file. `progress`, 0..1, is called before each file; `bits` as in RecordedSeries.
    static Result<std::unique_ptr<RecordedFrames>> open(hal::EventLoop& loop,
                                                        const std::vector<std::filesystem::path>& files_or_folders,
                                                        const std::function<void(double)>& progress = {}, int bits = 0);
    ~RecordedFrames() override { stop(); }
    [[nodiscard]] hal::SensorFormat format() const override;

    [[nodiscard]] std::size_t count() const { return frames_.size(); }

    using Noted = RecordedSeries::Noted;
    [[nodiscard]] const std::optional<Noted>& noted() const { return series_.noted(); }

  private:
    enum class State : std::uint8_t { free, exposing, lent };
    struct Slot {
        std::atomic<State> state{State::free};
        hal::FrameInfo info;
        hal::EventLoop::TimerId timer{};
    };
    RecordedFrames(hal::EventLoop& loop, int bits) : loop_(loop), series_(bits) {}
    Result<void> do_start(Listener& listener) override;
    Result<void> do_trigger(const hal::ExposureRequest& request) override;
    void do_stop() override;
    void do_give_back(std::uint32_t slot) noexcept override {
        slots_[slot].state.store(State::free, std::memory_order_release);
    }
    void deliver(std::uint32_t slot);
    [[nodiscard]] Error used_up() const;

    hal::EventLoop& loop_;
    std::vector<Frame> frames_;
    RecordedSeries series_;
    std::array<Slot, kBuffers> slots_;
    Listener* listener_ = nullptr;
    std::uint32_t sequence_ = 0;
    bool lost_ = false;
    hal::EventLoop::TimerId lost_timer_{};
};

}  // namespace hord::drivers
