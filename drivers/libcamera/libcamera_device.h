// libcamera's cameras in hord-camera.
#pragma once

#include <memory>
#include <string>

#include "drivers/camera_process/camera_host.h"

namespace hord::drivers {

// `request`: of libcamera_request.h; null where it is malformed. Opens nothing yet.
std::unique_ptr<CameraDevice> open_libcamera(const std::string& request);

}  // namespace hord::drivers
