// Options of the V4L2 sensor. The configuration reads them from [sensor]; deploy/hordd.toml documents the keys.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace hord::drivers {

struct V4l2SensorOptions {
    std::string device = "/dev/video0";
    int width_px = 0, height_px = 0;                             // 0: as the device is set
    int bits = 8;                                                // 8: GREY, 10: Y10 or Y10P, 12: Y12 or Y12P, 16: Y16
    int buffers = 4;                                             // one less can be lent at the same time
    std::vector<std::pair<std::string, std::int64_t>> controls;  // by name, as v4l2-ctl prints it; set at start
    bool operator==(const V4l2SensorOptions&) const = default;
};

}  // namespace hord::drivers
