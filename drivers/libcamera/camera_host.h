// The process that holds a camera for the station: the body of the program hord-camera and of the tests' replacements.
//
// Why a process: libcamera does not survive every loss of a camera
// (docs/adr/0005-libcamera-in-a-process-of-its-own.md). If this process crashes, hangs or spins, the station treats the
// camera as lost and starts the next process.
#pragma once

#include <cstddef>
#include <functional>
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

// A camera in the process that holds it: libcamera's or a test's.
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

constexpr int kCameraSocket = 3;  // the process inherits it

// Answers on kCameraSocket and streams until the other end closes it. When the camera is gone it calls _exit(), without
// destructors. Returns the exit status: 0, or 2 for invalid arguments (camera_wire.h).
int host_camera(int argc, char** argv,
                const std::function<std::unique_ptr<CameraDevice>(LibcameraSensorOptions)>& open);

}  // namespace hord::drivers
