#include "drivers/libcamera/libcamera_sensor.h"

#include <algorithm>
#include <atomic>
#include <map>
#include <mutex>

#include "drivers/hal/packed_samples.h"
#include "drivers/hal/spsc_queue.h"
#include "drivers/libcamera/camera_process.h"
#include "drivers/libcamera/libcamera_options.h"

namespace hord::drivers {
namespace {

using hal::TimePoint;

constexpr auto kBuffersMax = static_cast<std::uint32_t>(
    LibcameraSensorOptions::kMaxBuffers);  // a lease's slot is generation * kBuffersMax + buffer

}  // namespace

// The state of one start(): what the camera's thread writes to, and the memory that leases keep alive.
struct LibcameraSensor::Stream final : CameraPort::Listener {
    SpscQueue<CameraFrame, 2 * kBuffersMax> frames;
    std::atomic<bool> gone{false};
    std::shared_ptr<const CameraPort::Memory> memory;
    std::vector<std::vector<std::uint16_t>> unpacked;  // of each buffer, for packed and colour formats

    void on_camera_frame(const CameraFrame& frame) noexcept override {
        (void)frames.push(frame);  // never full: it has room for twice the camera's buffers
    }
    void on_camera_gone() noexcept override {
        gone = true;
        frames.notify();
    }
};

struct LibcameraSensor::LeaseTable {
    std::mutex mutex;
    std::uint32_t generation = 0;
    std::shared_ptr<Stream> stream;                         // null when stopped
    std::map<std::uint32_t, std::shared_ptr<Stream>> lent;  // by slot: keeps an earlier stream's memory
};

LibcameraSensor::LibcameraSensor(hal::EventLoop& loop, const LibcameraSensorOptions& request,
                                 std::unique_ptr<CameraPort> port, const CameraFormat& format)
    : loop_(loop), name_(request.camera.empty() ? "the camera" : request.camera), buffers_(request.buffers),
      port_(std::move(port)), camera_(format), format_{format.width_px, format.height_px, format.grey.bits,
                                                       request.buffers - 1},  // one stays with the camera
      leases_(std::make_unique<LeaseTable>()) {}
LibcameraSensor::~LibcameraSensor() { stop(); }

Result<std::unique_ptr<LibcameraSensor>> LibcameraSensor::open(hal::EventLoop& loop,
                                                               const LibcameraSensorOptions& request) {
    return open(loop, request, open_camera_process(request));
}

Result<std::unique_ptr<LibcameraSensor>> LibcameraSensor::open(hal::EventLoop& loop,
                                                               const LibcameraSensorOptions& request,
                                                               std::unique_ptr<CameraPort> port) {
    if (request.buffers < LibcameraSensorOptions::kMinBuffers ||
        request.buffers > LibcameraSensorOptions::kMaxBuffers) {
        return fail(ErrorCode::invalid_argument, "sensor.buffers must be in 2..32", "set it to 4");
    }
    const auto format = port->look();
    if (!format) return tl::unexpected(format.error());
    return std::unique_ptr<LibcameraSensor>(new LibcameraSensor(loop, request, std::move(port), *format));
}

Result<void> LibcameraSensor::do_start(Listener& listener) {
    auto stream = std::make_shared<Stream>();
    if (stream->frames.fd() < 0)
        return fail(ErrorCode::io, name_ + ": no descriptor for its frames", "raise the limit of open files");
    auto memory = port_->start(*stream);
    if (!memory) return tl::unexpected(memory.error());
    stream->memory = std::move(*memory);
    const std::size_t row = static_cast<std::size_t>(camera_.stride_bytes),
                      height = static_cast<std::size_t>(format_.height_px);
    Result<void> fits;
    if (stream->memory->size() < static_cast<std::size_t>(buffers_)) {
        fits = fail(ErrorCode::io, name_ + " gives only " + std::to_string(stream->memory->size()) + " buffers",
                    "set fewer sensor.buffers");
    } else if (std::ranges::any_of(*stream->memory, [&](const auto& buffer) { return buffer.size() < row * height; })) {
        fits = fail(ErrorCode::io, name_ + ": a buffer is smaller than a frame", "look at the kernel's log");
    }
    auto watch = loop_.watch(stream->frames.fd(), hal::EventLoop::Readiness::readable, [this] { read_frames(); });
    if (!fits || !watch) {
        port_->stop();
        if (watch) loop_.unwatch(*watch);
        return tl::unexpected(fits ? watch.error() : fits.error());
    }
    if (camera_.grey.packed || camera_.grey.green) {
        stream->unpacked.assign(stream->memory->size(),
                                std::vector<std::uint16_t>(static_cast<std::size_t>(format_.width_px) * height));
    }
    watch_ = *watch;
    listener_ = &listener;
    lost_ = false;
    waiting_.clear();
    untriggered_ = 0;
    const std::scoped_lock lock(leases_->mutex);
    ++leases_->generation;
    leases_->stream = std::move(stream);
    return {};
}

Result<void> LibcameraSensor::do_trigger(const hal::ExposureRequest& exposure) {
    if (lost_) return fail(ErrorCode::disconnected, name_ + " is gone", "stop it and start it again");
    const std::scoped_lock lock(leases_->mutex);
    const auto lent =
        std::ranges::count_if(leases_->lent, [&](const auto& lease) { return lease.second == leases_->stream; });
    if (static_cast<std::size_t>(lent) + waiting_.size() >= static_cast<std::size_t>(format_.buffers)) {
        return fail(ErrorCode::busy, name_ + ": every buffer is lent or filling",
                    "give frames back sooner, or set more sensor.buffers");
    }
    waiting_.push_back(exposure);
    if (waiting_.size() == 1) watch_for_silence();
    return {};
}

// An open trigger reserves a buffer, so the camera could deliver a frame.
void LibcameraSensor::watch_for_silence() {
    loop_.cancel(silence_timer_);
    const hal::ExposureRequest& oldest = waiting_.front();
    const TimePoint due = std::max(oldest.start + oldest.length, last_frame_) + kSilence;
    silence_timer_ = loop_.call_at(due, [this] {
        read_frames();  // those that came while the loop was busy
        if (listener_ == nullptr || lost_ || waiting_.empty()) return;
        if (std::max(waiting_.front().start + waiting_.front().length, last_frame_) + kSilence > loop_.now())
            return watch_for_silence();
        lose("gives no frames any more");
    });
}

void LibcameraSensor::read_frames() {
    std::shared_ptr<Stream> stream;
    {
        const std::scoped_lock lock(leases_->mutex);
        stream = leases_->stream;
    }
    if (!stream) return;
    stream->frames.acknowledge();
    while (const auto frame = stream->frames.pop()) {
        last_frame_ = loop_.now();
        deliver(*frame);
        if (listener_ == nullptr || lost_) return;  // the listener stopped the sensor
    }
    if (stream->gone) lose("was disconnected");
}

void LibcameraSensor::deliver(const CameraFrame& frame) {
    std::shared_ptr<Stream> stream;
    std::uint32_t slot = 0;
    const auto began = [&](const hal::ExposureRequest& exposure) {
        return frame.stamp_of_start ? frame.stamp : frame.stamp - exposure.length;
    };
    const bool triggered = !waiting_.empty() && began(waiting_.front()) >= waiting_.front().start;
    {
        const std::scoped_lock lock(leases_->mutex);
        stream = leases_->stream;
        if (frame.buffer >= stream->memory->size()) return lose("named a buffer that does not exist");
        if (!triggered) {
            ++untriggered_;
            if (const auto queued = port_->queue(frame.buffer); !queued) lose(queued.error().what);
            return;
        }
        slot = leases_->generation * kBuffersMax + frame.buffer;
        leases_->lent[slot] = stream;
    }
    const TimePoint start = began(waiting_.front());
    waiting_.erase(waiting_.begin());
    const std::byte* data = (*stream->memory)[frame.buffer].data();
    FrameView view{data, format_.width_px, format_.height_px, camera_.stride_bytes, format_.bits};
    std::size_t bytes_used = frame.bytes_used;
    if (camera_.grey.packed) {
        const auto width = static_cast<std::size_t>(format_.width_px);
        std::vector<std::uint16_t>& samples = stream->unpacked[frame.buffer];
        bytes_used =
            unpack_rows(data, static_cast<std::size_t>(camera_.stride_bytes), bytes_used, format_.bits, width, samples);
        view.data = reinterpret_cast<const std::byte*>(samples.data());
        view.stride_bytes = static_cast<std::ptrdiff_t>(width * sizeof(std::uint16_t));
    }
    if (camera_.grey.green) {
        const auto width = static_cast<std::size_t>(format_.width_px),
                   height = static_cast<std::size_t>(format_.height_px),
                   stride = static_cast<std::size_t>(camera_.stride_bytes);
        auto* const samples = reinterpret_cast<std::byte*>(stream->unpacked[frame.buffer].data());
        std::size_t whole = 0;  // complete rows
        for (; whole < height && whole * stride + 3 * width <= bytes_used; ++whole) {
            for (std::size_t x = 0; x < width; ++x) samples[whole * width + x] = data[whole * stride + 3 * x + 1];
        }
        bytes_used = whole * width;
        view.data = samples;
        view.stride_bytes = static_cast<std::ptrdiff_t>(width);
    }
    const hal::FrameInfo info{.sequence = frame.sequence - untriggered_,
                              .exposure_start = start,
                              .bytes_used = bytes_used,
                              .corrupt = frame.corrupt};
    listener_->on_frame(hal::FrameLease(*this, slot, view, info));
}

void LibcameraSensor::do_give_back(std::uint32_t slot) noexcept {
    const std::scoped_lock lock(leases_->mutex);
    const auto lease = leases_->lent.find(slot);
    if (lease == leases_->lent.end()) return;
    if (lease->second == leases_->stream) (void)port_->queue(slot % kBuffersMax);  // a failure shows as lost frames
    leases_->lent.erase(lease);
}

void LibcameraSensor::lose(const std::string& what) {
    if (lost_) return;
    lost_ = true;
    loop_.unwatch(watch_);
    loop_.cancel(silence_timer_);
    waiting_.clear();
    const Error why{ErrorCode::disconnected, name_ + " " + what, "check its cable; stop it and start it again"};
    lost_timer_ = loop_.call_after({}, [this, why] { listener_->on_sensor_lost(why); });
}

void LibcameraSensor::do_stop() {
    listener_ = nullptr;
    loop_.cancel(lost_timer_);
    loop_.cancel(silence_timer_);
    if (!lost_) loop_.unwatch(watch_);
    waiting_.clear();
    std::shared_ptr<Stream> stream;
    {
        const std::scoped_lock lock(leases_->mutex);
        stream = std::exchange(leases_->stream, nullptr);  // do_give_back() queues nothing from now on
    }
    port_->stop();  // until then the camera's thread uses `stream`
}

}  // namespace hord::drivers
