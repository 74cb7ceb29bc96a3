// Options of the GenICam sensor. The configuration reads them from [sensor]; deploy/hordd.toml documents the keys.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace hord::drivers {

constexpr int kSmallestGvspPacket = 576;  // bytes

enum class CameraTrigger : std::uint8_t { line, software, free };

struct GenicamSensorOptions {
    std::string camera = {};  // serial number, user-defined name, address or Aravis's id; empty: the only one there is
    int width_px = 0, height_px = 0;       // 0: as the camera is set
    int offset_x_px = 0, offset_y_px = 0;  // of the region on the sensor
    int bits = 8;                          // 8, 10, 12 or 16
    std::string pixel_format = {};         // PixelFormat; empty: the first of these bits that the camera has
    int buffers = 4;                       // one less can be lent at the same time
    CameraTrigger trigger = CameraTrigger::line;
    std::string trigger_source = {};  // TriggerSource of CameraTrigger::line
    int packet_bytes = 0;             // GigE; 0: negotiated
    int socket_buffer_bytes = 0;      // GigE; 0: one frame, at least 4 MiB, or what the kernel gives
    // Output that is active while the camera exposes, and for how long that is; empty: none. The strobe triggers then.
    std::string light_line = {};
    std::int64_t light_us = 0;
    std::int64_t exposure_us = 0;   // of the station (timing.exposure_us): the journal compares it; 0: unknown
    std::string barrier_line = {};  // input of a light barrier, whose edges the camera tells; empty: none
    std::vector<std::pair<std::string, std::string>> features = {};  // by name; set at start, in this order
    bool operator==(const GenicamSensorOptions&) const = default;
};

}  // namespace hord::drivers
