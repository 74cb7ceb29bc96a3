// The options as text, from the station to hord-camera.
#pragma once

#include <optional>
#include <string>

#include "drivers/libcamera/libcamera_options.h"

namespace hord::drivers {

std::string request_of(const LibcameraSensorOptions& options);
std::optional<LibcameraSensorOptions> parse_libcamera_request(const std::string& request);  // none: malformed

}  // namespace hord::drivers
