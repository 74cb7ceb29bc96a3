// What the sensor and the listing share of V4L2.
#pragma once

#include <array>
#include <cerrno>
#include <cstdint>
#include <string>

#include <linux/videodev2.h>
#include <sys/ioctl.h>

namespace hord::drivers::v4l2 {

inline int request(int fd, unsigned long code, void* argument) {
    for (;;) {
        const int r = ioctl(fd, code, argument);
        if (r >= 0 || errno != EINTR) return r;
    }
}

// Pixel formats by bit depth, the preferred one first. Older kernel headers have no Y12P.
struct Depth {
    int bits;
    std::uint32_t fourcc;
    bool packed = false;  // MIPI packing
};
inline constexpr std::array<Depth, 6> kDepths = {{{8, V4L2_PIX_FMT_GREY},
                                                  {10, V4L2_PIX_FMT_Y10},
                                                  {10, v4l2_fourcc('Y', '1', '0', 'P'), true},
                                                  {12, V4L2_PIX_FMT_Y12},
                                                  {12, v4l2_fourcc('Y', '1', '2', 'P'), true},
                                                  {16, V4L2_PIX_FMT_Y16}}};

inline std::string fourcc_text(std::uint32_t f) {
    return {static_cast<char>(f & 0xFF), static_cast<char>((f >> 8) & 0xFF), static_cast<char>((f >> 16) & 0xFF),
            static_cast<char>((f >> 24) & 0x7F)};
}

}  // namespace hord::drivers::v4l2
