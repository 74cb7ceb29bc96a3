#include "drivers/genicam/genicam_sensor.h"

#include "drivers/genicam/genicam_request.h"

namespace hord::drivers {

Result<std::unique_ptr<CameraPortSensor>> open_genicam_sensor(hal::EventLoop& loop, const GenicamSensorOptions& options,
                                                              const std::filesystem::path& program) {
    return CameraPortSensor::open(
        loop,
        {.name = options.camera.empty() ? "the camera" : options.camera,
         .buffers = options.buffers,
         .software_trigger = options.trigger == CameraTrigger::software && options.light_line.empty()},
        open_camera_process(request_of(options), program));
}

}  // namespace hord::drivers
