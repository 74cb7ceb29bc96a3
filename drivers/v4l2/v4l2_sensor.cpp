#include "drivers/v4l2/v4l2_sensor.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <map>
#include <mutex>
#include <span>

#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include "common/unique_fd.h"
#include "drivers/hal/packed_samples.h"

namespace hord::drivers {
namespace {

using hal::TimePoint;

constexpr auto kBuffersMax =
    static_cast<std::uint32_t>(V4l2SensorOptions::kMaxBuffers);  // a lease's slot is generation * kBuffersMax + buffer

int request(int fd, unsigned long code, void* argument) {
    for (;;) {
        const int r = ioctl(fd, code, argument);
        if (r >= 0 || errno != EINTR) return r;
    }
}

// Pixel formats by bit depth, the preferred one first. Older kernel headers have no Y12P.
struct Depth {
    int bits;
    std::uint32_t fourcc;
    bool packed = false;  // as MIPI does
};
constexpr std::array<Depth, 6> kDepths = {{{8, V4L2_PIX_FMT_GREY},
                                           {10, V4L2_PIX_FMT_Y10},
                                           {10, v4l2_fourcc('Y', '1', '0', 'P'), true},
                                           {12, V4L2_PIX_FMT_Y12},
                                           {12, v4l2_fourcc('Y', '1', '2', 'P'), true},
                                           {16, V4L2_PIX_FMT_Y16}}};

std::string fourcc_text(std::uint32_t f) {
    return {static_cast<char>(f & 0xFF), static_cast<char>((f >> 8) & 0xFF), static_cast<char>((f >> 16) & 0xFF),
            static_cast<char>((f >> 24) & 0x7F)};
}

std::string formats_of(int fd) {
    std::string out;
    v4l2_fmtdesc description{};
    description.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    for (; request(fd, VIDIOC_ENUM_FMT, &description) == 0; ++description.index) {
        out += (out.empty() ? "" : ", ") + fourcc_text(description.pixelformat);
    }
    return out.empty() ? "none" : out;
}

tl::unexpected<Error> failed(const std::string& device, const char* what, int error) {
    const ErrorCode code = error == EBUSY                      ? ErrorCode::busy
        : error == ENOENT || error == ENODEV || error == ENXIO ? ErrorCode::not_found
                                                               : ErrorCode::io;
    return fail(code, device + ": " + what + ": " + std::strerror(error),
                code == ErrorCode::busy            ? "close the program that uses it"
                    : code == ErrorCode::not_found ? "check the cable and sensor.device"
                    : error == EACCES              ? "join the group video"
                                                   : "look at the kernel's log");
}

}  // namespace

struct V4l2Sensor::Stream {
    common::UniqueFd fd;  // closing it also ends streaming and frees the buffers
    std::vector<std::pair<void*, std::size_t>> maps;
    Depth depth{};
    std::vector<std::vector<std::uint16_t>> unpacked;  // of each buffer, for packed formats

    ~Stream() {
        for (const auto& [data, size] : maps) munmap(data, size);
    }
    // The device's own buffer, or the unpacked samples and their size in `bytes_used`.
    FrameView view_of(std::uint32_t index, const hal::SensorFormat& format, std::ptrdiff_t stride_bytes,
                      std::size_t& bytes_used) {
        const auto* data = static_cast<const std::byte*>(maps[index].first);
        if (!depth.packed) return {data, format.width_px, format.height_px, stride_bytes, format.bits};
        const auto width = static_cast<std::size_t>(format.width_px);
        std::vector<std::uint16_t>& samples = unpacked[index];
        bytes_used = unpack_rows(data, static_cast<std::size_t>(stride_bytes), bytes_used, depth.bits, width, samples);
        return {reinterpret_cast<const std::byte*>(samples.data()), format.width_px, format.height_px,
                static_cast<std::ptrdiff_t>(width * sizeof(std::uint16_t)), format.bits};
    }
    int queue(std::uint32_t index) const {
        v4l2_buffer buffer{};
        buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
        buffer.memory = V4L2_MEMORY_MMAP;
        buffer.index = index;
        return request(fd.get(), VIDIOC_QBUF, &buffer);
    }
};

struct V4l2Sensor::LeaseTable {
    std::mutex mutex;
    std::uint32_t generation = 0;
    std::shared_ptr<Stream> stream;                         // null when stopped
    std::map<std::uint32_t, std::shared_ptr<Stream>> lent;  // by slot: keeps an earlier stream's memory mapped
};

V4l2Sensor::V4l2Sensor(hal::EventLoop& loop, const V4l2SensorOptions& options)
    : loop_(loop), options_(options), leases_(std::make_unique<LeaseTable>()) {}
V4l2Sensor::~V4l2Sensor() { stop(); }

Result<std::unique_ptr<V4l2Sensor>> V4l2Sensor::open(hal::EventLoop& loop, const V4l2SensorOptions& options) {
    if (options.buffers < V4l2SensorOptions::kMinBuffers || options.buffers > V4l2SensorOptions::kMaxBuffers) {
        return fail(ErrorCode::invalid_argument, "sensor.buffers must be in 2..32", "set it to 4");
    }
    std::unique_ptr<V4l2Sensor> sensor(new V4l2Sensor(loop, options));
    auto stream = sensor->open_stream();
    if (!stream) return tl::unexpected(stream.error());
    return sensor;
}

// Opens the device, agrees on the format, sets the controls.
Result<std::shared_ptr<V4l2Sensor::Stream>> V4l2Sensor::open_stream() {
    const std::string& device = options_.device;
    auto stream = std::make_shared<Stream>();
    stream->fd.reset(::open(device.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC));
    if (!stream->fd) return failed(device, "cannot be opened", errno);
    v4l2_capability capability{};
    const bool is_video = request(stream->fd.get(), VIDIOC_QUERYCAP, &capability) == 0;
    const std::uint32_t can =
        (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0 ? capability.device_caps : capability.capabilities;
    if (!is_video || (can & V4L2_CAP_VIDEO_CAPTURE) == 0 || (can & V4L2_CAP_STREAMING) == 0) {
        return fail(ErrorCode::unsupported, device + " is not a video device that streams frames",
                    "name the sensor's /dev/video node");
    }
    if (std::ranges::find(kDepths, options_.bits, &Depth::bits) == kDepths.end()) {
        return fail(ErrorCode::unsupported,
                    device + ": no format with " + std::to_string(options_.bits) + " bits is known",
                    "use 8, 10, 12 or 16");
    }
    v4l2_format format{};
    format.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    if (request(stream->fd.get(), VIDIOC_G_FMT, &format) != 0)
        return failed(device, "does not say its format (is the camera on?)", errno);
    v4l2_pix_format& pixel = format.fmt.pix;
    const std::uint32_t width = options_.width_px > 0 ? static_cast<std::uint32_t>(options_.width_px) : pixel.width;
    const std::uint32_t height = options_.height_px > 0 ? static_cast<std::uint32_t>(options_.height_px) : pixel.height;
    bool agreed = false;
    for (const Depth& depth : kDepths) {
        if (agreed || depth.bits != options_.bits) continue;
        pixel.width = width;
        pixel.height = height;
        pixel.pixelformat = depth.fourcc;
        pixel.field = V4L2_FIELD_NONE;
        pixel.bytesperline = 0;
        const bool accepted = request(stream->fd.get(), VIDIOC_S_FMT, &format) == 0;
        if (!accepted && errno == EBUSY) return failed(device, "its format cannot be set", EBUSY);
        agreed = accepted && pixel.pixelformat == depth.fourcc && pixel.width == width && pixel.height == height;
        stream->depth = depth;
    }
    if (!agreed) {
        std::string wanted;
        for (const Depth& depth : kDepths) {
            if (depth.bits == options_.bits) wanted += (wanted.empty() ? "" : " or ") + fourcc_text(depth.fourcc);
        }
        return fail(ErrorCode::unsupported,
                    device + " has no " + wanted + " frames of " + std::to_string(width) + "x" +
                        std::to_string(height) + "; it has " + formats_of(stream->fd.get()),
                    "set sensor.bits and the frame's size to what the device has (v4l2-ctl --list-formats-ext)");
    }
    if (stream->depth.packed && pixel.bytesperline < packed_row_bytes(stream->depth.bits, width)) {
        return fail(ErrorCode::io, device + ": a row is shorter than its samples", "look at the kernel's log");
    }
    for (const auto& [name, value] : options_.controls) {
        v4l2_queryctrl control{};
        control.id = V4L2_CTRL_FLAG_NEXT_CTRL;
        bool found = false;
        while (!found && request(stream->fd.get(), VIDIOC_QUERYCTRL, &control) == 0) {
            found = name == reinterpret_cast<const char*>(control.name);
            if (!found) control.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
        }
        v4l2_control setting{control.id, static_cast<std::int32_t>(value)};
        if (!found || request(stream->fd.get(), VIDIOC_S_CTRL, &setting) != 0) {
            return fail(ErrorCode::unsupported,
                        device + ": control \"" + name + "\" " +
                            (found ? "refuses " + std::to_string(value) : "does not exist"),
                        "see v4l2-ctl --list-ctrls");
        }
    }
    // One buffer stays with the device, so that the others can all be lent.
    format_ = {static_cast<int>(width), static_cast<int>(height), options_.bits, options_.buffers - 1};
    stride_bytes_ = static_cast<std::ptrdiff_t>(pixel.bytesperline);
    return stream;
}

Result<void> V4l2Sensor::do_start(Listener& listener) {
    auto opened = open_stream();
    if (!opened) return tl::unexpected(opened.error());
    const std::shared_ptr<Stream> stream = *opened;
    v4l2_requestbuffers buffers{};
    buffers.count = static_cast<std::uint32_t>(options_.buffers);
    buffers.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffers.memory = V4L2_MEMORY_MMAP;
    if (request(stream->fd.get(), VIDIOC_REQBUFS, &buffers) != 0)
        return failed(options_.device, "gives no buffers", errno);
    if (buffers.count < static_cast<std::uint32_t>(options_.buffers)) {
        return fail(ErrorCode::io, options_.device + " gives only " + std::to_string(buffers.count) + " buffers",
                    "set fewer sensor.buffers");
    }
    for (std::uint32_t k = 0; k < static_cast<std::uint32_t>(options_.buffers); ++k) {
        v4l2_buffer buffer{};
        buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
        buffer.memory = V4L2_MEMORY_MMAP;
        buffer.index = k;
        if (request(stream->fd.get(), VIDIOC_QUERYBUF, &buffer) != 0)
            return failed(options_.device, "does not describe its buffers", errno);
        void* data =
            mmap(nullptr, buffer.length, PROT_READ, MAP_SHARED, stream->fd.get(), static_cast<off_t>(buffer.m.offset));
        if (data == MAP_FAILED) return failed(options_.device, "its buffers cannot be mapped", errno);
        stream->maps.emplace_back(data, buffer.length);
        if (buffer.length < static_cast<std::size_t>(stride_bytes_) * static_cast<std::size_t>(format_.height_px)) {
            return fail(ErrorCode::io, options_.device + ": a buffer is smaller than a frame",
                        "look at the kernel's log");
        }
        if (stream->queue(k) != 0) return failed(options_.device, "a buffer cannot be queued", errno);
    }
    if (stream->depth.packed) {
        const auto samples = static_cast<std::size_t>(format_.width_px) * static_cast<std::size_t>(format_.height_px);
        stream->unpacked.assign(stream->maps.size(), std::vector<std::uint16_t>(samples));
    }
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    if (request(stream->fd.get(), VIDIOC_STREAMON, &type) != 0)
        return failed(options_.device, "does not stream", errno);
    auto watch = loop_.watch(stream->fd.get(), hal::EventLoop::Readiness::readable, [this] { on_ready(); });
    if (!watch) return tl::unexpected(watch.error());
    watch_ = *watch;
    listener_ = &listener;
    lost_ = false;
    waiting_.clear();
    untriggered_in_stream_ = 0;
    const std::scoped_lock lock(leases_->mutex);
    ++leases_->generation;
    leases_->stream = stream;
    return {};
}

Result<void> V4l2Sensor::do_trigger(const hal::ExposureRequest& exposure) {
    if (lost_) return fail(ErrorCode::disconnected, options_.device + " is gone", "stop it and start it again");
    const std::scoped_lock lock(leases_->mutex);
    const auto lent =
        std::ranges::count_if(leases_->lent, [&](const auto& loan) { return loan.second == leases_->stream; });
    if (static_cast<std::size_t>(lent) + waiting_.size() >= static_cast<std::size_t>(format_.buffers)) {
        return fail(ErrorCode::busy, options_.device + ": every buffer is lent or filling",
                    "give frames back sooner, or set more sensor.buffers");
    }
    waiting_.push_back(exposure);
    return {};
}

void V4l2Sensor::on_ready() {
    std::shared_ptr<Stream> stream;
    std::uint32_t generation = 0;
    {
        const std::scoped_lock lock(leases_->mutex);
        stream = leases_->stream;
        generation = leases_->generation;
    }
    if (!stream) return;
    v4l2_buffer buffer{};
    buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffer.memory = V4L2_MEMORY_MMAP;
    if (request(stream->fd.get(), VIDIOC_DQBUF, &buffer) != 0) {
        if (errno == EAGAIN) return;
        return lose("frames stopped", errno);
    }
    if (buffer.index >= stream->maps.size()) return lose("it named a buffer that does not exist", EIO);
    if (!watch_again(stream->fd.get())) return lose("it cannot be waited for", EIO);
    // The kernel's monotonic time stamp of the exposure's start or end is truncated to microseconds: the latest time
    // that it can stand for.
    const TimePoint stamp{std::chrono::seconds(buffer.timestamp.tv_sec) +
                          std::chrono::microseconds(buffer.timestamp.tv_usec) + std::chrono::nanoseconds(999)};
    const bool of_start = (buffer.flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
    const auto began = [&](const hal::ExposureRequest& asked) { return of_start ? stamp : stamp - asked.length; };
    if (waiting_.empty() || began(waiting_.front()) < waiting_.front().start) {
        ++untriggered_;
        ++untriggered_in_stream_;
        if (stream->queue(buffer.index) != 0) lose("a buffer cannot be queued", errno);
        return;
    }
    const TimePoint start = began(waiting_.front());
    waiting_.erase(waiting_.begin());
    const std::uint32_t slot = generation * kBuffersMax + buffer.index;
    {
        const std::scoped_lock lock(leases_->mutex);
        leases_->lent[slot] = stream;
    }
    std::size_t bytes_used = buffer.bytesused;
    const FrameView view = stream->view_of(buffer.index, format_, stride_bytes_, bytes_used);
    const hal::FrameInfo info{.sequence = buffer.sequence - untriggered_in_stream_,
                              .exposure_start = start,
                              .bytes_used = bytes_used,
                              .corrupt = (buffer.flags & V4L2_BUF_FLAG_ERROR) != 0};
    listener_->on_frame(hal::FrameLease(*this, slot, view, info));
}

// Watches the descriptor again after every frame: v4l2loopback 0.12 never wakes a waiter that was registered while a
// frame was readable.
bool V4l2Sensor::watch_again(int fd) {
    loop_.unwatch(watch_);
    auto watch = loop_.watch(fd, hal::EventLoop::Readiness::readable, [this] { on_ready(); });
    if (!watch) return false;
    watch_ = *watch;
    return true;
}

void V4l2Sensor::do_give_back(std::uint32_t slot) noexcept {
    const std::scoped_lock lock(leases_->mutex);
    const auto lease = leases_->lent.find(slot);
    if (lease == leases_->lent.end()) return;
    if (lease->second == leases_->stream)
        (void)lease->second->queue(slot % kBuffersMax);  // a failure shows as lost frames
    leases_->lent.erase(lease);                          // the last lease of an earlier stream unmaps and closes it
}

void V4l2Sensor::lose(const char* what, int error) {
    lost_ = true;
    loop_.unwatch(watch_);
    waiting_.clear();
    const Error why{ErrorCode::disconnected, options_.device + ": " + what + ": " + std::strerror(error),
                    "check the cable; stop it and start it again"};
    lost_timer_ = loop_.call_after({}, [this, why] { listener_->on_sensor_lost(why); });
}

void V4l2Sensor::do_stop() {
    listener_ = nullptr;
    loop_.cancel(lost_timer_);
    if (!lost_) loop_.unwatch(watch_);
    waiting_.clear();
    const std::scoped_lock lock(leases_->mutex);
    const std::shared_ptr<Stream> stream = std::exchange(leases_->stream, nullptr);
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    (void)request(stream->fd.get(), VIDIOC_STREAMOFF, &type);
    // Frees the device's queue, so that streaming can start again while frames are leased: their memory stays mapped
    // until the last lease ends. A driver that cannot orphan mapped buffers refuses; then a restart waits for the
    // leases.
    v4l2_requestbuffers none{};
    none.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    none.memory = V4L2_MEMORY_MMAP;
    (void)request(stream->fd.get(), VIDIOC_REQBUFS, &none);
}

}  // namespace hord::drivers
