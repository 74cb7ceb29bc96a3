// A camera in the process that holds it (camera_host.h): libcamera's, or a test's.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "drivers/libcamera/camera_port.h"

namespace hord::drivers {

// A buffer's memory as a file that can be mapped, in this process and in another that is given the descriptor.
struct CameraBuffer {
    int fd = -1;  // the device's: valid until stop()
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

    // Between start() and stop(): false once its device nodes are gone. Asks the file system alone, not the camera.
    [[nodiscard]] virtual bool is_there() = 0;
};

// The camera by libcamera. Opens nothing yet.
std::unique_ptr<CameraDevice> open_libcamera(CameraRequest request);

}  // namespace hord::drivers
