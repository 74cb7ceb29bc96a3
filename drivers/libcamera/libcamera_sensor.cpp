#include "drivers/libcamera/libcamera_sensor.h"

#include <algorithm>
#include <atomic>
#include <utility>

#include "drivers/hal/thread_safe_queue.h"
#include "drivers/libcamera/camera_process.h"

namespace hord::drivers {

// What the camera's thread writes to, and the memory that leases keep alive.
struct LibcameraSensor::Stream final : CameraStream, CameraPort::Listener, std::enable_shared_from_this<Stream> {
    explicit Stream(LibcameraSensor& s) : loop(s.loop_), port(*s.port_), sensor(&s) {}
    hal::EventLoop& loop;
    CameraPort& port;
    LibcameraSensor* sensor;  // loop's thread; null when stopped
    ThreadSafeQueue<CameraFrame> frames;
    std::atomic<bool> gone{false};
    std::shared_ptr<const CameraPort::Memory> keep;

    Result<void> queue(std::uint32_t buffer) override { return port.queue(buffer); }
    void on_camera_frame(const CameraFrame& frame) noexcept override {
        frames.push(frame);
        wake();
    }
    void on_camera_gone() noexcept override {
        gone = true;
        wake();
    }
    void wake() {
        loop.post([self = shared_from_this()] {
            if (self->sensor != nullptr) self->sensor->on_ready();
        });
    }
};

LibcameraSensor::LibcameraSensor(hal::EventLoop& loop, const LibcameraSensorOptions& request,
                                 std::unique_ptr<CameraPort> port, const CameraFormat& format)
    : CameraSensor(loop, request.camera.empty() ? "the camera" : request.camera), port_(std::move(port)) {
    format_ = {format.width_px, format.height_px, format.grey.bits, request.buffers - 1};  // one stays with the camera
    stride_bytes_ = format.stride_bytes;
    layout_ = format.grey.packed ? Layout::mipi : format.grey.green ? Layout::green : Layout::plain;
}
LibcameraSensor::~LibcameraSensor() { stop(); }

Result<std::unique_ptr<LibcameraSensor>> LibcameraSensor::open(hal::EventLoop& loop,
                                                               const LibcameraSensorOptions& request) {
    return open(loop, request, open_camera_process(request));
}

Result<std::unique_ptr<LibcameraSensor>> LibcameraSensor::open(hal::EventLoop& loop,
                                                               const LibcameraSensorOptions& request,
                                                               std::unique_ptr<CameraPort> port) {
    if (auto good = check_buffers(request.buffers); !good) return tl::unexpected(good.error());
    const auto format = port->look();
    if (!format) return tl::unexpected(format.error());
    return std::unique_ptr<LibcameraSensor>(new LibcameraSensor(loop, request, std::move(port), *format));
}

Result<void> LibcameraSensor::do_start(Listener& listener) {
    auto stream = std::make_shared<Stream>(*this);
    auto memory = port_->start(*stream);
    if (!memory) {
        stream->sensor = nullptr;
        return tl::unexpected(memory.error());
    }
    stream->keep = std::move(*memory);
    stream->memory = *stream->keep;
    stream_ = stream;
    auto begun = begin(std::move(stream), -1, listener);
    if (!begun) do_stop();
    return begun;
}

Result<void> LibcameraSensor::do_trigger(const hal::ExposureRequest& exposure) {
    auto done = CameraSensor::do_trigger(exposure);
    if (done && waiting_.size() == 1) watch_for_silence();
    return done;
}

// An open trigger reserves a buffer, so the camera could deliver a frame.
void LibcameraSensor::watch_for_silence() {
    const auto due = [this] {
        return std::max(waiting_.front().start + waiting_.front().length, last_frame_) + kSilence;
    };
    loop_.cancel(silence_timer_);
    silence_timer_ = loop_.call_at(due(), [this, due] {
        on_ready();  // for frames that came while the loop was busy
        if (!is_running() || waiting_.empty()) return;
        if (due() > loop_.now()) return watch_for_silence();
        lose(name_ + " gives no frames any more");
    });
}

void LibcameraSensor::on_ready() {
    const auto stream = stream_;
    if (!stream) return;
    while (const auto frame = stream->frames.pop()) {
        last_frame_ = loop_.now();
        deliver(*frame);
        if (!is_running() || stream != stream_) return;  // the listener stopped the sensor
    }
    if (stream->gone) lose(name_ + " was disconnected");
}

void LibcameraSensor::do_stop() {
    loop_.cancel(silence_timer_);
    end();
    const auto stream = std::exchange(stream_, nullptr);
    stream->sensor = nullptr;
    port_->stop();  // until then the camera's thread uses `stream`
}

}  // namespace hord::drivers
