#include "drivers/v4l2/v4l2_listing.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include <fcntl.h>
#include <unistd.h>

#include "common/device_access.h"
#include "common/unique_fd.h"
#include "drivers/v4l2/v4l2_device.h"

namespace hord::drivers {
namespace {

constexpr std::size_t kMaxSizes = 32;  // of a format

std::string size_text(std::uint32_t width, std::uint32_t height) {
    return std::to_string(width) + "x" + std::to_string(height);
}

void add_sizes(int fd, std::uint32_t fourcc, hal::ListedFormat& format) {
    const auto larger = [&format](std::uint32_t width, std::uint32_t height) {
        if (std::uint64_t{width} * height <=
            static_cast<std::uint64_t>(format.width_px) * static_cast<std::uint64_t>(format.height_px))
            return;
        format.width_px = static_cast<int>(width);
        format.height_px = static_cast<int>(height);
    };
    v4l2_frmsizeenum size{};
    size.pixel_format = fourcc;
    for (; format.sizes.size() < kMaxSizes && v4l2::request(fd, VIDIOC_ENUM_FRAMESIZES, &size) == 0; ++size.index) {
        if (size.type == V4L2_FRMSIZE_TYPE_DISCRETE) {
            larger(size.discrete.width, size.discrete.height);
            format.sizes.push_back(size_text(size.discrete.width, size.discrete.height));
            continue;
        }
        const auto& range = size.stepwise;
        larger(range.max_width, range.max_height);
        format.sizes.push_back(size_text(range.min_width, range.min_height) + " to " +
                               size_text(range.max_width, range.max_height));
        return;
    }
}

// True: another program has its buffers. Frees none: only their owner can.
bool is_streaming(int fd) {
    v4l2_requestbuffers none{};
    none.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    none.memory = V4L2_MEMORY_MMAP;
    return v4l2::request(fd, VIDIOC_REQBUFS, &none) != 0 && errno == EBUSY;
}

std::string text_of(const unsigned char* text, std::size_t size) {
    const auto* letters = reinterpret_cast<const char*>(text);
    return std::string(letters, ::strnlen(letters, size));
}

// False: no device that captures frames.
bool read(const std::string& path, hal::ListedCamera& camera) {
    camera.name = path;
    const common::UniqueFd fd(::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC));
    if (!fd) {
        const int error = errno;
        camera.problem = std::string("cannot be opened: ") + std::strerror(error);
        camera.cure = error == EACCES || error == EPERM ? common::access_cure(path)
            : error == EBUSY                            ? "close the program that uses it"
                                                        : "look at the kernel's log";
        return true;
    }
    v4l2_capability capability{};
    if (v4l2::request(fd.get(), VIDIOC_QUERYCAP, &capability) != 0) {
        camera.problem = "is no video device";
        camera.cure = "look at the kernel's log";
        return true;
    }
    const std::uint32_t can =
        (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0 ? capability.device_caps : capability.capabilities;
    if ((can & V4L2_CAP_VIDEO_CAPTURE) == 0 || (can & V4L2_CAP_STREAMING) == 0) return false;
    camera.text = text_of(capability.card, sizeof capability.card) + " (" +
        text_of(capability.driver, sizeof capability.driver) + ", " +
        text_of(capability.bus_info, sizeof capability.bus_info) + ")";
    v4l2_fmtdesc description{};
    description.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    for (; v4l2::request(fd.get(), VIDIOC_ENUM_FMT, &description) == 0; ++description.index) {
        hal::ListedFormat& format = camera.formats.emplace_back();
        format.name = v4l2::fourcc_text(description.pixelformat);
        while (format.name.ends_with(' ')) format.name.pop_back();
        const auto known = std::ranges::find(v4l2::kDepths, description.pixelformat, &v4l2::Depth::fourcc);
        if (known != v4l2::kDepths.end()) format.bits = known->bits;
        add_sizes(fd.get(), description.pixelformat, format);
    }
    if (is_streaming(fd.get())) camera.holder = "another program";
    return true;
}

}  // namespace

std::vector<hal::ListedCamera> list_v4l2_cameras(const std::filesystem::path& dev) {
    std::vector<std::string> paths;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(dev, error)) {
        const std::string name = entry.path().filename().string();
        if (name.starts_with("video") && name.size() > 5 &&
            name.find_first_not_of("0123456789", 5) == std::string::npos)
            paths.push_back(entry.path().string());
    }
    std::ranges::sort(paths, {}, [](const std::string& path) { return std::pair(path.size(), path); });
    std::vector<hal::ListedCamera> cameras;
    for (const std::string& path : paths) {
        hal::ListedCamera camera;
        if (read(path, camera)) cameras.push_back(std::move(camera));
    }
    return cameras;
}

}  // namespace hord::drivers
