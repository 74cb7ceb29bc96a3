// Options of the libcamera sensor. The configuration reads them from [sensor]; deploy/hordd.toml documents the keys.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace hord::drivers {

struct LibcameraSensorOptions {
    std::string camera = {};          // its id, as `cam -l` prints it; empty: the only one there is
    int width_px = 0, height_px = 0;  // 0: as the camera proposes
    int bits = 8;                     // 8, 10, 12 or 16
    int buffers = 4;                  // one less can be lent at the same time
    bool green = false;               // 8 bits, no grey format: use the green samples of BGR888 or RGB888 frames
    std::vector<std::pair<std::string, std::int64_t>> controls = {};  // by libcamera's names; set at start
    bool operator==(const LibcameraSensorOptions&) const = default;
};

}  // namespace hord::drivers
