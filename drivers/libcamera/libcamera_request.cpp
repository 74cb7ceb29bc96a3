#include "drivers/libcamera/libcamera_request.h"

#include "drivers/camera_process/camera_request.h"

namespace hord::drivers {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LibcameraSensorOptions, camera, width_px, height_px, bits, buffers, green, controls)

std::string request_of(const LibcameraSensorOptions& options) { return text_of_request(options); }

std::optional<LibcameraSensorOptions> parse_libcamera_request(const std::string& request) {
    return parse_request<LibcameraSensorOptions>(request);
}

}  // namespace hord::drivers
