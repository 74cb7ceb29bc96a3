#include "drivers/camera_process/camera_port_sensor.h"

#include <algorithm>
#include <utility>

#include "drivers/hal/packed_samples.h"
#include "drivers/hal/thread_safe_queue.h"

namespace hord::drivers {
namespace {

constexpr int kMaxSide = 65'536;  // pixels

// A frame of it can be read: its rows hold their samples.
bool is_possible(const CameraFormat& format) {
    const int bits = format.grey.bits;
    if (format.width_px < 1 || format.width_px > kMaxSide || format.height_px < 1 || format.height_px > kMaxSide ||
        bits < 8 || bits > 16 || format.stride_bytes < 1 || format.stride_bytes > std::ptrdiff_t{4} * kMaxSide)
        return false;
    const std::ptrdiff_t width = format.width_px;
    switch (format.grey.layout) {
        case SampleLayout::plain: return format.stride_bytes >= width * (bits > 8 ? 2 : 1);
        case SampleLayout::green: return format.stride_bytes >= width * 3;
        case SampleLayout::mipi:
            return static_cast<std::size_t>(format.stride_bytes) >=
                packed_row_bytes(bits, static_cast<std::size_t>(width));
        case SampleLayout::gige:
        case SampleLayout::pfnc: return true;  // unpacked where the whole frame is there
    }
    return false;
}

}  // namespace

// What the camera's thread writes to, and the memory that leases keep alive.
struct CameraPortSensor::Stream final : CameraStream, CameraPort::Listener, std::enable_shared_from_this<Stream> {
    explicit Stream(CameraPortSensor& s) : loop(s.loop_), port(*s.port_), sensor(&s) {}
    hal::EventLoop& loop;
    CameraPort& port;
    CameraPortSensor* sensor;  // loop's thread; null when stopped
    ThreadSafeQueue<CameraFrame> frames;
    ThreadSafeQueue<CameraEdge> edges;
    struct Loss {
        std::string why, cure;
    };
    ThreadSafeQueue<Loss> losses;
    std::shared_ptr<const CameraPort::Memory> keep;

    Result<void> queue(std::uint32_t buffer) override {
        auto queued = port.queue(buffer);
        // Of a camera that is gone the listener hears why.
        if (!queued && queued.error().code == ErrorCode::disconnected) return {};
        return queued;
    }
    void on_camera_frame(const CameraFrame& frame) noexcept override {
        frames.push(frame);
        wake();
    }
    void on_camera_edge(const CameraEdge& edge) noexcept override {
        edges.push(edge);
        wake();
    }
    void on_camera_gone(std::string_view why, std::string_view cure) noexcept override {
        losses.push({std::string(why.empty() ? "was disconnected" : why), std::string(cure)});
        wake();
    }
    void wake() {
        loop.post([self = shared_from_this()] {
            if (self->sensor != nullptr) self->sensor->on_ready();
        });
    }
};

CameraPortSensor::CameraPortSensor(hal::EventLoop& loop, const CameraPortOptions& options,
                                   std::unique_ptr<CameraPort> port, const CameraFormat& format)
    : CameraSensor(loop, options.name, options.triggers, options.cure_of_silence), port_(std::move(port)),
      commands_(options.triggers == CameraTriggers::command && !options.strobe_commands) {
    format_ = {format.width_px, format.height_px, format.grey.bits, options.buffers - 1};  // one stays with the camera
    stride_bytes_ = format.stride_bytes;
    layout_ = format.grey.layout;
}
CameraPortSensor::~CameraPortSensor() { stop(); }

Result<std::unique_ptr<CameraPortSensor>> CameraPortSensor::open(hal::EventLoop& loop, const CameraPortOptions& options,
                                                                 std::unique_ptr<CameraPort> port) {
    if (auto good = check_buffers(options.buffers); !good) return tl::unexpected(good.error());
    const auto format = port->look();
    if (!format) return tl::unexpected(format.error());
    if (!is_possible(*format))
        return fail(ErrorCode::io, options.name + " is said to have an impossible format", "install the package again");
    return std::unique_ptr<CameraPortSensor>(new CameraPortSensor(loop, options, std::move(port), *format));
}

Result<void> CameraPortSensor::do_start(Listener& listener) {
    auto stream = std::make_shared<Stream>(*this);
    auto memory = port_->start(*stream);
    if (!memory) {
        stream->sensor = nullptr;
        return tl::unexpected(memory.error());
    }
    stream->keep = std::move(*memory);
    stream->memory = *stream->keep;
    stream_ = stream;
    silent_since_.reset();
    auto begun = begin(std::move(stream), -1, listener);
    if (!begun) do_stop();
    else if (edges_ != nullptr) edges_->on_camera_streams();
    return begun;
}

Result<void> CameraPortSensor::do_trigger(const hal::ExposureRequest& exposure) {
    auto done = CameraSensor::do_trigger(exposure);
    if (!done) return done;
    if (triggers_ != CameraTriggers::command) expect_frame_after(exposure.start + exposure.length);
    if (commands_) {
        loop_.call_at(exposure.start, [stream = stream_, number = exposure.exposure] {
            if (stream->sensor != nullptr) (void)stream->sensor->expose(number);  // its failure shows as a lost frame
        });
    }
    return done;
}

Result<void> CameraPortSensor::expose(std::uint32_t exposure) {
    if (!streams()) return fail(ErrorCode::disconnected, name_ + " does not stream", "start the sensor");
    if (auto begun = begin_command(exposure); !begun) return begun;
    expect_frame_after(loop_.now());
    return port_->trigger();
}

void CameraPortSensor::on_lost(const Error& error) {
    if (exposures_ != nullptr) exposures_->on_camera_lost(error);
    if (edges_ != nullptr) edges_->on_camera_lost(error);
}

// An open trigger reserves a buffer, so the camera could deliver a frame.
void CameraPortSensor::expect_frame_after(hal::TimePoint time) {
    if (silent_since_) return;
    silent_since_ = time;
    watch_for_silence();
}

void CameraPortSensor::watch_for_silence() {
    loop_.cancel(silence_timer_);
    silence_timer_ = loop_.call_at(*silent_since_ + kSilence, [this] {
        on_ready();  // for frames that came while the loop was busy
        if (!is_running() || !silent_since_) return;
        if (*silent_since_ + kSilence > loop_.now()) return watch_for_silence();
        lose(name_ + " gives no frames any more", cure_of_silence_ + "; stop it and start it again");
    });
}

void CameraPortSensor::on_ready() {
    const auto stream = stream_;
    if (!stream) return;
    while (const auto edge = stream->edges.pop()) {  // before the frames: a part's edge comes before its exposure
        if (edges_ != nullptr) edges_->on_camera_edge(*edge);
        if (!is_running() || stream != stream_) return;  // the listener stopped the sensor
    }
    while (const auto frame = stream->frames.pop()) {
        silent_since_.reset();
        if (exposures_ != nullptr) exposures_->on_exposure(*frame);
        if (!is_running() || stream != stream_) return;
        deliver(*frame);
        if (!is_running() || stream != stream_) return;  // the listener stopped the sensor
        if (!waiting_.empty() && triggers_ != CameraTriggers::command)
            expect_frame_after(std::max(waiting_.front().start + waiting_.front().length, loop_.now()));
    }
    const auto loss = stream->losses.pop();
    if (!loss) return;
    if (loss->cure.empty()) lose(name_ + " " + loss->why);
    else lose(name_ + " " + loss->why, loss->cure);
}

void CameraPortSensor::do_stop() {
    loop_.cancel(silence_timer_);
    end();
    const auto stream = std::exchange(stream_, nullptr);
    stream->sensor = nullptr;
    port_->stop();  // until then the camera's thread uses `stream`
}

}  // namespace hord::drivers
