// Opens each of the configuration's devices separately, so that an absent one does not hide the others.
#pragma once

#include <memory>
#include <optional>

#include "algo/recipe/recipe.h"
#include "firmware/devices/active_calibration.h"
#include "firmware/devices/device_factory.h"
#include "firmware/diagnostics/device_diagnostics.h"

namespace hord::firmware {

struct EachDevice {
    CellUnderTest cell;
    std::shared_ptr<void> keep;  // owns the devices of `cell`; release it before the loop
};

// `recipe` and `calibration` are those of the configuration, as a start reads them. With `simulate`, opens the
// simulated cell and a coil module on loopback instead. Fails if the calibration does not fit the sensor; a device's
// error is in its entry of the cell.
Result<EachDevice> open_each_device(hal::EventLoop& loop, const Config& config, const algo::Recipe& recipe,
                                    const std::optional<ActiveCalibration>& calibration, bool simulate);

}  // namespace hord::firmware
