// The outputs of the core. The station carries them out in this order and reports failures as events.
#pragma once

#include <array>
#include <cstddef>
#include <cstdlib>
#include <variant>

#include "firmware/core/events.h"
#include "firmware/core/station_types.h"

namespace hord::firmware {

struct StartDevice {  // an open device is closed first
    Device device{};
};
struct StopDevices {};
struct Inspect {  // the frame and its ownership go to the inspector
    std::uint32_t part = 0;
    FrameHandle frame = 0;
};
struct ReleaseFrame {
    FrameHandle frame = 0;
};
struct SetRunPermit {
    bool permit = false;
};

// ExposureRequest: trigger the sensor. StrobePulse: fire the light. RejectCommand: reject. PartResult: record it;
// nothing about the part changes any more.
using Action = std::variant<std::monostate, StartDevice, StopDevices, hal::ExposureRequest, hal::StrobePulse, Inspect,
                            ReleaseFrame, hal::RejectCommand, SetRunPermit, PartResult>;

// A list of fixed capacity that never allocates. The core defers work to its next step when it is nearly full.
class Actions {
  public:
    static constexpr std::size_t kCapacity = 64;

    void clear() { size_ = 0; }
    void push(const Action& action) {
        if (size_ == kCapacity) std::abort();  // a bug: a lost rejection would pass a bad part
        list_[size_++] = action;
    }
    [[nodiscard]] std::size_t room() const { return kCapacity - size_; }
    [[nodiscard]] std::size_t size() const { return size_; }
    [[nodiscard]] const Action* begin() const { return list_.data(); }
    [[nodiscard]] const Action* end() const { return list_.data() + size_; }

  private:
    std::array<Action, kCapacity> list_;
    std::size_t size_ = 0;
};

}  // namespace hord::firmware
