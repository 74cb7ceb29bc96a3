#include "tests/system/rig/video_out.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

namespace hord::rig {

VideoOut::VideoOut(std::string device, int width_px, int height_px)
    : device_(std::move(device)), width_(width_px), height_(height_px) {
    open();
}

void VideoOut::open() {
    if (fd_ >= 0) return;
    fd_ = ::open(device_.c_str(), O_RDWR | O_CLOEXEC);
    if (fd_ < 0) throw std::runtime_error(device_ + " cannot be opened for writing");
    v4l2_format format{};
    format.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    format.fmt.pix.width = static_cast<std::uint32_t>(width_);
    format.fmt.pix.height = static_cast<std::uint32_t>(height_);
    format.fmt.pix.pixelformat = V4L2_PIX_FMT_GREY;
    format.fmt.pix.field = V4L2_FIELD_NONE;
    format.fmt.pix.colorspace = V4L2_COLORSPACE_RAW;
    if (ioctl(fd_, VIDIOC_S_FMT, &format) != 0 || format.fmt.pix.width != static_cast<std::uint32_t>(width_) ||
        format.fmt.pix.height != static_cast<std::uint32_t>(height_) ||
        format.fmt.pix.pixelformat != V4L2_PIX_FMT_GREY) {
        throw std::runtime_error(device_ + " takes no GREY frames of this size: " + std::strerror(errno));
    }
    // Readers find no format before the device's first frame; a real camera has already sent some.
    const std::vector<std::byte> dark(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
    send({dark.data(), width_, height_, width_, 8});
}

void VideoOut::close() {
    if (fd_ >= 0) ::close(std::exchange(fd_, -1));
}

void VideoOut::send(const FrameView& frame, std::size_t bytes) {
    if (fd_ < 0) return;
    std::vector<std::byte> packed;
    packed.reserve(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
    for (int y = 0; y < frame.height_px; ++y) {
        const std::byte* row = frame.data + y * frame.stride_bytes;
        packed.insert(packed.end(), row, row + frame.width_px);
    }
    const std::size_t count = std::min(bytes, packed.size());
    if (::write(fd_, packed.data(), count) != static_cast<ssize_t>(count))
        throw std::runtime_error(device_ + " does not take a frame: " + std::strerror(errno));
}

}  // namespace hord::rig
