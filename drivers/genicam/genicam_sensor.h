// The lenslet sensor of a GenICam camera (GigE Vision, USB3 Vision), which hord-genicam holds.
#pragma once

#include <filesystem>
#include <memory>

#include "drivers/camera_process/camera_port_sensor.h"
#include "drivers/camera_process/camera_process.h"
#include "drivers/genicam/genicam_options.h"

namespace hord::drivers {

// Fails as CameraPortSensor::open() does.
Result<std::unique_ptr<CameraPortSensor>> open_genicam_sensor(
    hal::EventLoop& loop, const GenicamSensorOptions& options,
    const std::filesystem::path& program = camera_program("hord-genicam"));

}  // namespace hord::drivers
