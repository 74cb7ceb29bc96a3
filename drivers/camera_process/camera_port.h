// What a sensor needs of a camera whose library runs in another process (camera_process.h,
// docs/adr/0005-libcamera-in-a-process-of-its-own.md); for tests to implement.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/result.h"
#include "drivers/hal/camera_sensor.h"

namespace hord::drivers {

// A pixel format that holds grey samples of the requested depth.
struct GreyFormat {
    std::string name;  // the library's: "R8", "Mono12Packed"
    int bits = 8;
    SampleLayout layout = SampleLayout::plain;
};

// "a, b", or "none".
std::string list_of(std::span<const std::string> names);

// Without control characters: for text that comes from a device.
std::string one_line(std::string text);

// The first of `known` that has the requested bits and is available. Fails with unsupported: names the request and
// lists the available formats.
Result<GreyFormat> choose_grey_format(const std::string& camera, std::span<const std::string> available,
                                      std::span<const GreyFormat> known, int bits, const std::string& cure);

struct CameraFormat {
    int width_px = 0, height_px = 0;
    GreyFormat grey;
    std::ptrdiff_t stride_bytes = 0;
};

// An edge of a light barrier on the camera's input.
struct CameraEdge {
    bool active = false;
    std::uint32_t sequence = 0;  // from 1 at each start(); a gap means that edges may have been lost
    hal::TimePoint at;
};

class CameraPort {
  public:
    // Called on the camera's threads; must not block.
    class Listener {
      public:
        virtual void on_camera_frame(const CameraFrame& frame) noexcept = 0;
        virtual void on_camera_edge(const CameraEdge&) noexcept {}
        // May be called more than once. `why`: the end of the sentence "the camera ..."; `cure`: what to do about it.
        // Empty where they are not known.
        virtual void on_camera_gone(std::string_view why, std::string_view cure) noexcept = 0;

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

    // Any thread, between start() and stop(). Queues a buffer to be filled again; does not block. Fails with
    // disconnected (the camera is gone: the listener hears why), busy.
    virtual Result<void> queue(std::uint32_t buffer) = 0;

    // The same. A software trigger: the exposure begins as soon as the camera gets it. Its failure shows as a camera
    // that is gone.
    virtual Result<void> trigger() = 0;

    // Releases the camera. No call reaches the listener after it returns.
    virtual void stop() = 0;
};

}  // namespace hord::drivers
