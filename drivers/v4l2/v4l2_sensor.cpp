#include "drivers/v4l2/v4l2_sensor.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <span>

#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include "common/unique_fd.h"
#include "drivers/hal/packed_samples.h"
#include "drivers/v4l2/v4l2_device.h"

namespace hord::drivers {
namespace {

using v4l2::Depth;
using v4l2::fourcc_text;
using v4l2::kDepths;
using v4l2::request;

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

v4l2_buffer mapped_buffer() {
    v4l2_buffer buffer{};
    buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffer.memory = V4L2_MEMORY_MMAP;
    return buffer;
}

// Requests `count` mapped buffers of the driver. 0 frees them all.
int request_buffers(int fd, std::uint32_t& count) {
    v4l2_requestbuffers buffers{};
    buffers.count = count;
    buffers.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffers.memory = V4L2_MEMORY_MMAP;
    const int r = request(fd, VIDIOC_REQBUFS, &buffers);
    count = buffers.count;
    return r;
}

// Agrees with the device on the options' size and depth. `format`: what it took.
Result<Depth> agree_on_format(int fd, const std::string& device, const V4l2SensorOptions& options,
                              v4l2_format& format) {
    if (std::ranges::find(kDepths, options.bits, &Depth::bits) == kDepths.end()) {
        return fail(ErrorCode::unsupported,
                    device + ": no format with " + std::to_string(options.bits) + " bits is known",
                    "use 8, 10, 12 or 16");
    }
    format.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    if (request(fd, VIDIOC_G_FMT, &format) != 0)
        return failed(device, "does not say its format (is the camera on?)", errno);
    v4l2_pix_format& pixel = format.fmt.pix;
    const std::uint32_t width = options.width_px > 0 ? static_cast<std::uint32_t>(options.width_px) : pixel.width;
    const std::uint32_t height = options.height_px > 0 ? static_cast<std::uint32_t>(options.height_px) : pixel.height;
    bool agreed = false;
    Depth used{};
    for (const Depth& depth : kDepths) {
        if (agreed || depth.bits != options.bits) continue;
        pixel.width = width;
        pixel.height = height;
        pixel.pixelformat = depth.fourcc;
        pixel.field = V4L2_FIELD_NONE;
        pixel.bytesperline = 0;
        const bool accepted = request(fd, VIDIOC_S_FMT, &format) == 0;
        if (!accepted && errno == EBUSY) return failed(device, "its format cannot be set", EBUSY);
        agreed = accepted && pixel.pixelformat == depth.fourcc && pixel.width == width && pixel.height == height;
        used = depth;
    }
    if (!agreed) {
        std::string wanted;
        for (const Depth& depth : kDepths) {
            if (depth.bits == options.bits) wanted += (wanted.empty() ? "" : " or ") + fourcc_text(depth.fourcc);
        }
        return fail(ErrorCode::unsupported,
                    device + " has no " + wanted + " frames of " + std::to_string(width) + "x" +
                        std::to_string(height) + "; it has " + formats_of(fd),
                    "set sensor.bits and the frame's size to what the device has (v4l2-ctl --list-formats-ext)");
    }
    if (used.packed && pixel.bytesperline < packed_row_bytes(used.bits, width)) {
        return fail(ErrorCode::io, device + ": a row is shorter than its samples", "look at the kernel's log");
    }
    return used;
}

Result<void> set_controls(int fd, const std::string& device,
                          std::span<const std::pair<std::string, std::int64_t>> controls) {
    for (const auto& [name, value] : controls) {
        v4l2_queryctrl control{};
        control.id = V4L2_CTRL_FLAG_NEXT_CTRL;
        bool found = false;
        while (!found && request(fd, VIDIOC_QUERYCTRL, &control) == 0) {
            found = name == reinterpret_cast<const char*>(control.name);
            if (!found) control.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
        }
        v4l2_control setting{control.id, static_cast<std::int32_t>(value)};
        if (!found || request(fd, VIDIOC_S_CTRL, &setting) != 0) {
            return fail(ErrorCode::unsupported,
                        device + ": control \"" + name + "\" " +
                            (found ? "refuses " + std::to_string(value) : "does not exist"),
                        "see v4l2-ctl --list-ctrls");
        }
    }
    return {};
}

}  // namespace

struct V4l2Sensor::Stream final : CameraStream {
    common::UniqueFd fd;  // closing it also ends streaming and frees the buffers

    ~Stream() override {
        for (const auto& mapped : memory) munmap(const_cast<std::byte*>(mapped.data()), mapped.size());
    }
    Result<void> queue(std::uint32_t index) override {
        v4l2_buffer buffer = mapped_buffer();
        buffer.index = index;
        if (request(fd.get(), VIDIOC_QBUF, &buffer) == 0) return {};
        return fail(ErrorCode::io, std::string("a buffer cannot be queued: ") + std::strerror(errno));
    }
};

V4l2Sensor::V4l2Sensor(hal::EventLoop& loop, const V4l2SensorOptions& options)
    : CameraSensor(loop, options.device), options_(options) {}
V4l2Sensor::~V4l2Sensor() { stop(); }

Result<std::unique_ptr<V4l2Sensor>> V4l2Sensor::open(hal::EventLoop& loop, const V4l2SensorOptions& options) {
    if (auto good = check_buffers(options.buffers); !good) return tl::unexpected(good.error());
    std::unique_ptr<V4l2Sensor> sensor(new V4l2Sensor(loop, options));
    auto stream = sensor->open_stream();
    if (!stream) return tl::unexpected(stream.error());
    return sensor;
}

// Opens the device, agrees on the format, sets the controls.
Result<std::shared_ptr<V4l2Sensor::Stream>> V4l2Sensor::open_stream() {
    const std::string& device = name_;
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
    const int fd = stream->fd.get();
    v4l2_format format{};
    const auto used = agree_on_format(fd, device, options_, format);
    if (!used) return tl::unexpected(used.error());
    if (auto set = set_controls(fd, device, options_.controls); !set) return tl::unexpected(set.error());
    // One buffer stays with the device, so that the others can all be lent.
    const v4l2_pix_format& pixel = format.fmt.pix;
    format_ = {static_cast<int>(pixel.width), static_cast<int>(pixel.height), options_.bits, options_.buffers - 1};
    stride_bytes_ = static_cast<std::ptrdiff_t>(pixel.bytesperline);
    layout_ = used->packed ? SampleLayout::mipi : SampleLayout::plain;
    return stream;
}

Result<void> V4l2Sensor::do_start(Listener& listener) {
    auto opened = open_stream();
    if (!opened) return tl::unexpected(opened.error());
    Stream& stream = **opened;
    const int fd = stream.fd.get();
    const auto wanted = static_cast<std::uint32_t>(options_.buffers);
    std::uint32_t count = wanted;
    if (request_buffers(fd, count) != 0) return failed(name_, "gives no buffers", errno);
    for (std::uint32_t k = 0; k < std::min(count, wanted); ++k) {
        v4l2_buffer buffer = mapped_buffer();
        buffer.index = k;
        if (request(fd, VIDIOC_QUERYBUF, &buffer) != 0) return failed(name_, "does not describe its buffers", errno);
        void* data = mmap(nullptr, buffer.length, PROT_READ, MAP_SHARED, fd, static_cast<off_t>(buffer.m.offset));
        if (data == MAP_FAILED) return failed(name_, "its buffers cannot be mapped", errno);
        stream.memory.emplace_back(static_cast<const std::byte*>(data), buffer.length);
        if (!stream.queue(k)) return failed(name_, "a buffer cannot be queued", errno);
    }
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    if (request(fd, VIDIOC_STREAMON, &type) != 0) return failed(name_, "does not stream", errno);
    fd_ = fd;
    return begin(std::move(*opened), fd, listener);
}

void V4l2Sensor::on_ready() {
    v4l2_buffer buffer = mapped_buffer();
    if (request(fd_, VIDIOC_DQBUF, &buffer) != 0) {
        if (errno != EAGAIN) lose(name_ + ": frames stopped: " + std::strerror(errno));
        return;
    }
    // Watched again after every frame: v4l2loopback 0.12 never wakes a waiter that was registered while a frame was
    // readable.
    if (const auto watched = watch(fd_); !watched) return lose(name_ + ": " + watched.error().what);
    // The kernel's monotonic time stamp is truncated to microseconds: the latest time that it can stand for.
    const hal::TimePoint stamp{std::chrono::seconds(buffer.timestamp.tv_sec) +
                               std::chrono::microseconds(buffer.timestamp.tv_usec) + std::chrono::nanoseconds(999)};
    deliver({.buffer = buffer.index,
             .sequence = buffer.sequence,
             .stamp = stamp,
             .stamp_of_start = (buffer.flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE,
             .bytes_used = buffer.bytesused,
             .corrupt = (buffer.flags & V4L2_BUF_FLAG_ERROR) != 0});
}

void V4l2Sensor::do_stop() {
    const auto stream = end();
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    (void)request(fd_, VIDIOC_STREAMOFF, &type);
    // Frees the device's queue, so that streaming can start again while frames are leased: their memory stays mapped
    // until the last lease ends. A driver that cannot orphan mapped buffers refuses; then a restart waits for the
    // leases.
    std::uint32_t none = 0;
    (void)request_buffers(fd_, none);
}

}  // namespace hord::drivers
