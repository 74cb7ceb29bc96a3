// A camera in the process that holds it (camera_host.h): libcamera's or a test's.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "drivers/libcamera/camera_port.h"
#include "drivers/libcamera/libcamera_options.h"

namespace hord::drivers {

// A buffer's memory as a file: this process and any that receives the descriptor can map it.
struct CameraBuffer {
    int fd = -1;  // owned by the device, valid until stop()
    std::size_t offset = 0, bytes = 0;
};

class CameraDevice {
  public:
    virtual ~CameraDevice() = default;

    // As CameraPort's.
    virtual Result<CameraFormat> look() = 0;
    virtual Result<std::vector<CameraBuffer>> start(CameraPort::Listener& listener) = 0;
    virtual Result<void> queue(std::uint32_t buffer) = 0;
    virtual void stop() = 0;

    // Between start() and stop(): false when its device nodes are gone. Checks the file system only, not the camera.
    [[nodiscard]] virtual bool is_there() = 0;
};

// Opens nothing yet.
std::unique_ptr<CameraDevice> open_libcamera(LibcameraSensorOptions request);

}  // namespace hord::drivers
