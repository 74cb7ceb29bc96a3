// The lenslet sensor. Frames are leased and returned.
#pragma once

#include <cstdint>
#include <memory>

#include "common/frame.h"
#include "drivers/hal/clock.h"
#include "drivers/hal/device.h"

namespace hord::hal {

struct SensorFormat {
    int width_px = 0;
    int height_px = 0;
    int bits = 8;     // 8..16
    int buffers = 0;  // frames that may be lent at the same time
};

struct ExposureRequest {
    std::uint32_t exposure = 0;
    TimePoint start;
    Duration length{};
};

// The device's description of a frame. The station's core does not trust it: it matches frames to the exposures that it
// triggered.
struct FrameInfo {
    std::uint32_t sequence = 0;  // the device's own count; a gap means lost frames
    TimePoint exposure_start;    // device timestamp
    std::size_t bytes_used = 0;  // fewer than the format needs: a short frame
    bool corrupt = false;        // the device flagged an error
    std::uint32_t exposure = 0;  // ExposureRequest::exposure whose trigger made it; 0: the device cannot tell
    bool nobodys = false;        // commands alone make frames, and nothing proves that an open one made this frame
};

class Sensor;

// A frame in the sensor's buffer. The destructor returns the buffer, on any thread; the sensor must outlive the lease.
class FrameLease {
  public:
    FrameLease() = default;
    FrameLease(Sensor& owner, std::uint32_t slot, FrameView view, FrameInfo info)
        : owner_(&owner, {slot}), view_(view), info_(info) {}

    [[nodiscard]] explicit operator bool() const { return owner_ != nullptr; }
    [[nodiscard]] const FrameView& view() const { return view_; }
    [[nodiscard]] const FrameInfo& info() const { return info_; }
    void give_back() noexcept { owner_.reset(); }

  private:
    struct GiveBack {
        std::uint32_t slot;
        void operator()(Sensor* owner) const noexcept;
    };
    std::unique_ptr<Sensor, GiveBack> owner_;
    FrameView view_;
    FrameInfo info_;
};

class SensorListener {
  public:
    virtual void on_frame(FrameLease frame) = 0;
    virtual void on_sensor_lost(const Error& error) = 0;  // delivered once; stop() and start() again to recover

  protected:
    ~SensorListener() = default;
};

// start() fails with not_found, unsupported (the format; lists the available ones), busy, io. Leased frames stay
// readable after stop() until they are returned.
class Sensor : public Device<SensorListener> {
  public:
    [[nodiscard]] virtual SensorFormat format() const = 0;

    // Loop thread, does not block. Requests one frame. It may come late or never: the caller watches the deadline.
    // Fails with disconnected (not started or lost), busy (no free buffer), invalid_argument (length <= 0).
    Result<void> trigger(const ExposureRequest& request);

  protected:
    Sensor() : Device("the sensor") {}

  private:
    friend class FrameLease;
    virtual Result<void> do_trigger(const ExposureRequest& request) = 0;
    virtual void do_give_back(std::uint32_t slot) noexcept = 0;  // any thread
};

}  // namespace hord::hal
