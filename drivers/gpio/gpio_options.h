// Options of the strobe and the part sensor on GPIO lines. The configuration reads them from [strobe] and
// [part_sensor]; deploy/hordd.toml documents the keys.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "drivers/hal/clock.h"
#include "drivers/hal/light_budget.h"

namespace hord::drivers {

using hal::LightLimits;

// A line of the kernel's GPIO character device.
struct GpioLine {
    enum class Bias : std::uint8_t { as_is, disabled, pull_up, pull_down };
    std::string chip;         // its label, its name ("gpiochip0") or its path; see gpiodetect
    std::string line;         // its name, or its offset in digits; see gpioinfo
    bool active_low = false;  // active while the wire is at 0
    Bias bias = Bias::as_is;  // of an input; as_is: as the board has set it
    bool operator==(const GpioLine&) const = default;
};

struct GpioStrobeChannel {
    GpioLine line;
    LightLimits limits;
    bool operator==(const GpioStrobeChannel&) const = default;
};

// The configuration checks the ranges.
struct GpioPartSensorOptions {
    GpioLine line;
    hal::Duration debounce = std::chrono::microseconds(200);  // 0..100 ms; edges are reported this much later
    std::optional<GpioLine> encoder;
    hal::Duration encoder_every = std::chrono::milliseconds(5);  // 1 ms..1 s: its position is reported
    bool operator==(const GpioPartSensorOptions&) const = default;
};

}  // namespace hord::drivers
