// The configuration's devices, each opened by itself: one that is absent does not hide the others.
#pragma once

#include <memory>

#include "firmware/devices/device_factory.h"
#include "firmware/diagnostics/device_diagnostics.h"

namespace hord::firmware {

struct EachDevice {
    CellUnderTest cell;
    std::shared_ptr<void> keep;  // owns the devices; outlives `cell`'s use, dies before the loop
};

// Opens what `config` names. With `simulate`, the simulated cell and a coil module on loopback instead of all of it.
// Fails with what is wrong with the recipe or the calibration; a device's failure is in its place in the cell.
Result<EachDevice> open_each_device(hal::EventLoop& loop, const Config& config, bool simulate);

}  // namespace hord::firmware
