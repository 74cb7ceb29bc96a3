// What the sensors of real cameras share: frames are matched with triggers, buffers are lent and queued again.
//
// The pipeline reads the camera's buffer; returning the lease queues it again. Only packed and colour formats are
// copied. How a frame finds its trigger depends on what triggers the camera:
//   unknown  it runs free, or a wire triggers it. A frame answers the oldest open trigger, unless its exposure began
//   before
//            that trigger's start. A trigger whose frame had not come when the next trigger's exposure began is
//            forgotten: its frame was lost. A frame without a trigger is queued again and leaves no gap in the
//            sequence.
//   wire     the same, but each frame has a pulse on the wire: a frame without a trigger is delivered as nobody's.
//   command  the station commands each exposure, one at a time: the next command is given when the frame of the last
//   one
//            has come, or after kPatience. So a frame answers the command that is open, however late the camera obeyed;
//            one that began before the command was given is delivered as nobody's. After a command that was given up,
//            its frame may still come. Then a time stamp of an unknown error proves nothing: a frame is the open
//            command's only if its number is that of the last frame that was matched plus the commands since then (one
//            command makes one frame). Else it is nobody's; kMaxUnproven such frames in a row are a loss.
// A frame says whose exposure it answers where a command made it (FrameInfo::exposure).
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/sensor.h"

namespace hord::drivers {

// How samples lie in a frame (packed_samples.h). green: three bytes a pixel; the middle one is used.
enum class SampleLayout : std::uint8_t { plain, mipi, gige, pfnc, green };

struct CameraFrame {
    std::uint32_t buffer = 0;
    std::uint32_t sequence = 0;
    hal::TimePoint stamp;
    bool stamp_of_start = false;  // time stamps are of the exposure's start; else of its end
    std::size_t bytes_used = 0;
    bool corrupt = false;
    bool stamp_error_known = false;  // the camera's clock was read; else the stamp may be late by any time
};

// One start() to its stop(). Leases keep it alive.
struct CameraStream {
    std::vector<std::span<const std::byte>> memory;    // of each buffer
    std::vector<std::vector<std::uint16_t>> unpacked;  // the same for packed and colour formats
    virtual ~CameraStream() = default;
    virtual Result<void> queue(std::uint32_t buffer) = 0;  // any thread
};

enum class CameraTriggers : std::uint8_t { unknown, wire, command };

class CameraSensor : public hal::Sensor {
  public:
    static constexpr int kMinBuffers = 2, kMaxBuffers = 32;
    static constexpr hal::Duration kPatience = std::chrono::seconds(1);  // for the frame of a command
    static constexpr int kMaxUnproven = 3;

    [[nodiscard]] hal::SensorFormat format() const final { return format_; }

  protected:
    // `cure_of_silence`: what to check where triggers bring no frame.
    CameraSensor(hal::EventLoop& loop, std::string name, CameraTriggers triggers = CameraTriggers::unknown,
                 std::string cure_of_silence = "check what triggers it, and its cable")
        : loop_(loop), name_(std::move(name)), triggers_(triggers), cure_of_silence_(std::move(cure_of_silence)) {}

    static Result<void> check_buffers(int buffers);  // fails with invalid_argument

    // on_ready() is called whenever `fd` is readable; -1: the subclass calls it. Set format_, stride_bytes_ and
    // layout_ before.
    Result<void> begin(std::shared_ptr<CameraStream> stream, int fd, Listener& listener);
    Result<void> watch(int fd);
    virtual void on_ready() = 0;
    virtual void on_lost(const Error&) {}  // called where the loss is found, before the listener's turn
    void deliver(const CameraFrame& frame);
    // CameraTriggers::command, before the command for `exposure` is given. Fails with busy: the frame of the last
    // command has not come; `exposure` brings no frame then.
    Result<void> begin_command(std::uint32_t exposure);
    void lose(const std::string& what, const std::string& cure = "check its cable; stop it and start it again");
    std::shared_ptr<CameraStream> end();  // from now on no returned buffer is queued again

    [[nodiscard]] bool is_running() const { return listener_ != nullptr && !lost_; }
    Result<void> do_trigger(const hal::ExposureRequest& request) override;

    hal::EventLoop& loop_;
    const std::string name_;  // for messages
    const CameraTriggers triggers_;
    const std::string cure_of_silence_;
    hal::SensorFormat format_;
    std::ptrdiff_t stride_bytes_ = 0;
    SampleLayout layout_ = SampleLayout::plain;
    std::vector<hal::ExposureRequest> waiting_;  // triggers without a frame

  private:
    void do_give_back(std::uint32_t slot) noexcept final;
    FrameView view_of(CameraStream& stream, std::uint32_t buffer, std::size_t& bytes_used) const;
    void forget_what_was_not_commanded();
    struct Match {
        std::vector<hal::ExposureRequest>::iterator trigger;  // end: none
        std::uint32_t exposure = 0;                           // FrameInfo::exposure
    };
    Match match(const CameraFrame& frame);
    [[nodiscard]] bool answers_open_command(const CameraFrame& frame) const;

    Listener* listener_ = nullptr;
    bool lost_ = false;
    hal::EventLoop::WatchId watch_{};
    hal::EventLoop::TimerId lost_timer_{};
    std::uint32_t untriggered_ = 0;  // frames since start
    struct Commanded {
        std::uint32_t exposure = 0;
        hal::TimePoint at;
    };
    std::optional<Commanded> commanded_;  // its frame has not come
    std::uint32_t commands_ = 0;          // since start
    struct Matched {
        std::uint32_t sequence = 0, commands = 0;  // of the frame; commands_ when it came
    };
    std::optional<Matched> last_match_;
    bool given_up_ = false;           // a command since the last match
    int unproven_ = 0;                // frames since the last match
    hal::TimePoint last_delivery_{};  // of a frame, with a trigger or without

    // A lease's slot is generation * kMaxBuffers + buffer: a lease of an earlier stream is returned to that stream.
    std::mutex mutex_;
    std::uint32_t generation_ = 0;
    std::shared_ptr<CameraStream> stream_;                         // null when stopped
    std::map<std::uint32_t, std::shared_ptr<CameraStream>> lent_;  // by slot
};

}  // namespace hord::drivers
