#include "drivers/libcamera/libcamera_sensor.h"

#include "drivers/camera_process/camera_process.h"
#include "drivers/libcamera/libcamera_request.h"

namespace hord::drivers {

Result<std::unique_ptr<CameraPortSensor>> open_libcamera_sensor(hal::EventLoop& loop,
                                                                const LibcameraSensorOptions& options) {
    return CameraPortSensor::open(
        loop, {.name = options.camera.empty() ? "the camera" : options.camera, .buffers = options.buffers},
        open_camera_process(request_of(options), camera_program("hord-camera")));
}

std::string libcamera_version() { return HORD_LIBCAMERA_VERSION; }

}  // namespace hord::drivers
