// GPIO lines of the kernel's character device, by libgpiod: outputs that are off when they are requested, and inputs
// that report edges with the kernel's time stamps.
//
// When the holder of a line releases it or is killed, the chip's driver sets the level. So a light needs a
// pull resistor that turns it off, and the cleanup after a killed holder calls request_outputs() once more.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/result.h"
#include "drivers/gpio/gpio_options.h"
#include "drivers/hal/clock.h"

namespace hord::drivers {

class GpioOutputs {
  public:
    virtual ~GpioOutputs() = default;
    // Any one thread. Bit k of `active` is line k of the request; lines of one chip change together. Fails with
    // disconnected (the chip is gone) or io; some lines may have changed then.
    virtual Result<void> set(std::uint32_t active) = 0;
};

struct GpioEdge {
    bool active = false;     // the level after it, as the kernel read it: a little later than `at`
    hal::TimePoint at;       // when the interrupt came
    std::uint32_t lost = 0;  // edges lost by the kernel next to this one, at least
};

class GpioInput {
  public:
    virtual ~GpioInput() = default;
    [[nodiscard]] virtual int fd() const = 0;  // readable while an edge is queued
    // One thread. Appends the queued edges, in order; does not block. Fails with disconnected or io.
    virtual Result<void> read(std::vector<GpioEdge>& into) = 0;
    // The present level. Fails with disconnected; nothing else shows that the chip went away.
    [[nodiscard]] virtual Result<bool> active() = 0;
};

enum class GpioEdges : std::uint8_t { both, activations };

// Both block while the chips are opened. Outputs: 1 to 32 lines, all off on return, also after a failure. Fail with
// not_found (chip or line; lists the chips), busy (names the holder), invalid_argument (two chips with that label, a
// line named twice), io.
Result<std::unique_ptr<GpioOutputs>> request_outputs(const std::vector<GpioLine>& lines);
Result<std::unique_ptr<GpioInput>> request_input(const GpioLine& line, GpioEdges edges);

[[nodiscard]] std::string gpiod_version();

namespace gpio {
[[nodiscard]] std::string name_of(const GpioLine& line);  // for messages
[[nodiscard]] int offset_of(const std::string& line);     // -1: not a number
}  // namespace gpio

}  // namespace hord::drivers
