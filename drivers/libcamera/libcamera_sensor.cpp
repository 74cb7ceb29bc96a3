#include "drivers/libcamera/libcamera_sensor.h"

#include <algorithm>
#include <atomic>

#include "drivers/hal/spsc_queue.h"
#include "drivers/libcamera/camera_process.h"

namespace hord::drivers {

// What the camera's thread writes to, and the memory that leases keep alive.
struct LibcameraSensor::Stream final : CameraStream, CameraPort::Listener {
    explicit Stream(CameraPort& p) : port(p) {}
    CameraPort& port;
    SpscQueue<CameraFrame, 2 * kMaxBuffers> frames;
    std::atomic<bool> gone{false};
    std::shared_ptr<const CameraPort::Memory> keep;

    Result<void> queue(std::uint32_t buffer) override { return port.queue(buffer); }
    void on_camera_frame(const CameraFrame& frame) noexcept override {
        (void)frames.push(frame);  // never full: it has room for twice the camera's buffers
    }
    void on_camera_gone() noexcept override {
        gone = true;
        frames.notify();
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
    auto stream = std::make_shared<Stream>(*port_);
    if (stream->frames.fd() < 0)
        return fail(ErrorCode::io, name_ + ": no descriptor for its frames", "raise the limit of open files");
    auto memory = port_->start(*stream);
    if (!memory) return tl::unexpected(memory.error());
    stream->keep = std::move(*memory);
    stream->memory = *stream->keep;
    auto begun = begin(stream, stream->frames.fd(), listener);
    if (begun) stream_ = std::move(stream);
    else port_->stop();
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
    stream->frames.acknowledge();
    while (const auto frame = stream->frames.pop()) {
        last_frame_ = loop_.now();
        deliver(*frame);
        if (!is_running() || stream != stream_) return;  // the listener stopped the sensor
    }
    if (stream->gone) lose(name_ + " was disconnected");
}

void LibcameraSensor::do_stop() {
    loop_.cancel(silence_timer_);
    const auto stream = end();
    stream_.reset();
    port_->stop();  // until then the camera's thread uses `stream`
}

}  // namespace hord::drivers
