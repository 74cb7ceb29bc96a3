// What the libcamera sensor needs of a camera, for tests to implement. libcamera itself runs in a process of its own
// (camera_process.h, docs/adr/0005-libcamera-in-a-process-of-its-own.md).
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/result.h"
#include "drivers/hal/camera_sensor.h"

namespace hord::drivers {

// A pixel format that holds grey samples of the requested depth.
struct GreyFormat {
    std::string name;  // libcamera's: "R8", "R10_CSI2P"
    int bits = 8;
    bool packed = false;  // MIPI packing: to be unpacked
    bool green = false;   // three bytes a pixel; the middle one is used
};

// The best of `available` for grey samples of `bits`: unpacked, then packed, then colour (with `green`). Fails with
// unsupported: names the request and lists the available formats.
Result<GreyFormat> choose_grey_format(const std::string& camera, std::span<const std::string> available, int bits,
                                      bool green = false);

// The id of the wanted camera; empty: the only one. Fails with not_found (names the request and lists the cameras) and
// invalid_argument (none was named and there are several).
Result<std::string> choose_camera(std::span<const std::string> available, const std::string& wanted);

struct CameraFormat {
    int width_px = 0, height_px = 0;
    GreyFormat grey;
    std::ptrdiff_t stride_bytes = 0;
};

class CameraPort {
  public:
    // Called on the camera's thread; must not block.
    class Listener {
      public:
        virtual void on_camera_frame(const CameraFrame& frame) noexcept = 0;
        virtual void on_camera_gone() noexcept = 0;  // may be called more than once

      protected:
        ~Listener() = default;
    };
    using Memory = std::vector<std::span<const std::byte>>;  // of each buffer

    virtual ~CameraPort() = default;

    // Negotiates the format and releases the camera. Fails with not_found, busy, unsupported, io.
    virtual Result<CameraFormat> look() = 0;

    // Acquires the camera and streams; all buffers are queued. The memory stays readable while the pointer is held,
    // also after stop(). Fails as look() does, and with an unknown or refused control.
    virtual Result<std::shared_ptr<const Memory>> start(Listener& listener) = 0;

    // Any thread, between start() and stop(). Queues a buffer to be filled again; does not block.
    virtual Result<void> queue(std::uint32_t buffer) = 0;

    // Releases the camera. No call reaches the listener after it returns.
    virtual void stop() = 0;
};

}  // namespace hord::drivers
