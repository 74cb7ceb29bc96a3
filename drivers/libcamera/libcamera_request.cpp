#include "drivers/libcamera/libcamera_request.h"

#include <nlohmann/json.hpp>

namespace hord::drivers {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LibcameraSensorOptions, camera, width_px, height_px, bits, buffers, green, controls)

std::string request_of(const LibcameraSensorOptions& options) {
    return nlohmann::json(options).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::optional<LibcameraSensorOptions> parse_libcamera_request(const std::string& request) {
    try {
        return nlohmann::json::parse(request).get<LibcameraSensorOptions>();
    } catch (const nlohmann::json::exception&) {
        return std::nullopt;
    }
}

}  // namespace hord::drivers
