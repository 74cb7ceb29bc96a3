// Opens each of the configuration's devices separately, so that an absent one does not hide the others.
#pragma once

#include <memory>

#include "firmware/devices/device_factory.h"
#include "firmware/diagnostics/device_diagnostics.h"

namespace hord::firmware {

struct EachDevice {
    CellUnderTest cell;
    std::shared_ptr<void> keep;  // owns the devices of `cell`; release it before the loop
};

// With `simulate`, opens the simulated cell and a coil module on loopback instead. Fails if the recipe or the
// calibration cannot be used; a device's error is in its entry of the cell.
Result<EachDevice> open_each_device(hal::EventLoop& loop, const Config& config, bool simulate);

}  // namespace hord::firmware
