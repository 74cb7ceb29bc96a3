#include "drivers/genicam/genicam_request.h"

#include "drivers/camera_process/camera_request.h"

namespace hord::drivers {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(GenicamSensorOptions, camera, width_px, height_px, offset_x_px, offset_y_px, bits,
                                   pixel_format, buffers, trigger, trigger_source, packet_bytes, socket_buffer_bytes,
                                   light_line, light_us, exposure_us, barrier_line, features)

std::string request_of(const GenicamSensorOptions& options) { return text_of_request(options); }

std::optional<GenicamSensorOptions> parse_genicam_request(const std::string& request) {
    return parse_request<GenicamSensorOptions>(request);
}

}  // namespace hord::drivers
