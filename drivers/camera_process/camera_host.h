// The process that holds a camera for the station: the body of the programs hord-camera and hord-genicam and of the
// tests' replacements.
//
// Why a process: docs/adr/0005-libcamera-in-a-process-of-its-own.md. If this process crashes, hangs or spins, the
// station treats the camera as lost and starts the next process.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "drivers/camera_process/camera_port.h"
#include "drivers/hal/listed_camera.h"

namespace hord::drivers {

// A buffer's memory as a file: this process and any that receives the descriptor can map it.
struct CameraBuffer {
    int fd = -1;  // owned by the device, valid until stop()
    std::size_t offset = 0, bytes = 0;
};

// A camera in the process that holds it.
class CameraDevice {
  public:
    virtual ~CameraDevice() = default;

    // The cameras that this process could hold. Takes none that another program holds. Fails with io, unsupported.
    virtual Result<std::vector<hal::ListedCamera>> list() {
        return fail(ErrorCode::unsupported, "cameras cannot be listed");
    }
    // As CameraPort's.
    virtual Result<CameraFormat> look() = 0;
    virtual Result<std::vector<CameraBuffer>> start(CameraPort::Listener& listener) = 0;
    virtual Result<void> queue(std::uint32_t buffer) = 0;
    virtual Result<void> trigger() { return fail(ErrorCode::unsupported, "it has no software trigger"); }
    virtual void stop() = 0;

    // Every 100 ms and for each message between start() and stop(), on the thread of queue(). False when the camera is
    // gone. Must not block for long.
    [[nodiscard]] virtual bool is_there() = 0;
    // As CameraPort::Listener::on_camera_gone() gets it.
    [[nodiscard]] virtual std::string why_gone() { return {}; }
};

constexpr int kCameraSocket = 3;  // the process inherits it

// `open` makes the device of a request (camera_wire.h), null for one that is malformed; it opens no camera yet. Answers
// on kCameraSocket and streams until the other end closes it. When the camera is gone it calls _exit(), without
// destructors. Returns the exit status: 0, or 2 for invalid arguments, which it says on stderr.
int host_camera(int argc, char** argv,
                const std::function<std::unique_ptr<CameraDevice>(const std::string& request)>& open);

}  // namespace hord::drivers
