// GenICam cameras in hord-genicam, by Aravis.
#pragma once

#include <memory>

#include "drivers/camera_process/camera_host.h"
#include "drivers/genicam/genicam_options.h"

namespace hord::drivers {

// Opens nothing yet.
std::unique_ptr<CameraDevice> open_genicam(const GenicamSensorOptions& options);

}  // namespace hord::drivers
