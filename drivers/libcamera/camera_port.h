// What the libcamera sensor needs of a camera: so small that a test can be one. libcamera itself is in a process of its
// own (camera_process.h, docs/adr/0005-libcamera-in-a-process-of-its-own.md).
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/result.h"
#include "drivers/hal/clock.h"

namespace hord::drivers {

struct CameraRequest {
    std::string camera = {};  // its id, as `cam -l` prints it; empty: the only one there is
    int width_px = 0;         // 0: as the camera proposes
    int height_px = 0;
    int bits = 8;  // 8, 10, 12 or 16
    int buffers = 4;
    bool green = false;  // 8 bits: where there are no grey frames, the green samples of BGR888 or RGB888 ones
    std::vector<std::pair<std::string, std::int64_t>> controls = {};  // by libcamera's names
};

// How grey samples of so many bits are called and kept.
struct GreyFormat {
    std::string name;  // libcamera's: "R8", "R10_CSI2P"
    int bits = 8;
    bool packed = false;  // as MIPI packs them: unpacked on the way
    bool green = false;   // pixels of three bytes, of which the middle one is taken
};

// The first of `there` that holds grey samples of `bits`, unpacked ones before packed ones, colour (with `green`) last.
// Fails with unsupported: says what was wanted and lists what there is.
Result<GreyFormat> choose_grey_format(const std::string& camera, std::span<const std::string> there, int bits,
                                      bool green = false);

// The id of the camera that is meant. Fails with not_found (names what was asked for and lists what there is) and
// invalid_argument (none was named, and there are several).
Result<std::string> choose_camera(std::span<const std::string> there, const std::string& wanted);

struct CameraFormat {
    int width_px = 0, height_px = 0;
    GreyFormat grey;
    std::ptrdiff_t stride_bytes = 0;
};

struct CameraFrame {
    std::uint32_t buffer = 0;
    std::uint32_t sequence = 0;
    hal::TimePoint stamp;
    bool stamp_of_start = false;  // of the exposure; else of its end
    std::size_t bytes_used = 0;
    bool corrupt = false;
};

class CameraPort {
  public:
    // Called on the camera's own thread, which must not be held up.
    class Listener {
      public:
        virtual void on_camera_frame(const CameraFrame& frame) noexcept = 0;
        virtual void on_camera_gone() noexcept = 0;  // may be told more than once

      protected:
        ~Listener() = default;
    };
    using Memory = std::vector<std::span<const std::byte>>;  // of each buffer

    virtual ~CameraPort() = default;

    // Agrees on the format; holds nothing afterwards. Fails with not_found, busy, unsupported, io.
    virtual Result<CameraFormat> look() = 0;

    // Takes the camera and streams; every buffer is with it. The memory stays readable for as long as somebody holds
    // it, even after stop(). Fails as look() does, and where a control is unknown or refused.
    virtual Result<std::shared_ptr<const Memory>> start(Listener& listener) = 0;

    // Any thread, between start() and stop(). Gives a buffer back to be filled; does not block.
    virtual Result<void> queue(std::uint32_t buffer) = 0;

    // Lets go of the camera. No call reaches the listener after it returns.
    virtual void stop() = 0;
};

}  // namespace hord::drivers
