// The lenslet sensor behind libcamera, which hord-camera holds.
#pragma once

#include <memory>
#include <string>

#include "drivers/camera_process/camera_port_sensor.h"
#include "drivers/libcamera/libcamera_options.h"

namespace hord::drivers {

// Fails as CameraPortSensor::open() does.
Result<std::unique_ptr<CameraPortSensor>> open_libcamera_sensor(hal::EventLoop& loop,
                                                                const LibcameraSensorOptions& options);

std::string libcamera_version();  // of the build

}  // namespace hord::drivers
