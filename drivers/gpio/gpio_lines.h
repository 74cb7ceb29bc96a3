// GPIO lines of the kernel's character device, by libgpiod: outputs that are off from the moment they are taken, and
// inputs that tell their edges with the kernel's time stamps.
//
// Two generations of the library stand behind this header, libgpiod 1.6 (gpio_lines_v1.cpp) and 2.x
// (gpio_lines_v2.cpp); the build takes the one that fits what is installed.
//
// What becomes of a line when its holder lets go of it, or is killed: the kernel closes the request either way, and the
// chip's driver decides. Some turn the line into an input (a pull resistor then decides), some leave it as it was.
// So a light needs a pull resistor that turns it off, and whoever cleans up after a killed holder takes the lines once
// more: request_outputs() drives them to off.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/result.h"
#include "drivers/hal/clock.h"

namespace hord::drivers {

struct GpioLine {
    enum class Bias : std::uint8_t {
        as_is,
        disabled,
        pull_up,
        pull_down
    };                        // of an input; as_is: as the board has set it
    std::string chip;         // its label, its name ("gpiochip0") or its path; see gpiodetect
    std::string line;         // its name, or its offset in digits; see gpioinfo
    bool active_low = false;  // active while the wire is at 0
    Bias bias = Bias::as_is;
    bool operator==(const GpioLine&) const = default;
};

class GpioOutputs {
  public:
    virtual ~GpioOutputs() = default;
    // Any one thread. Bit k of `active` is line k of the request; lines of one chip change together. Fails with
    // disconnected (the chip is gone) or io; some lines may have changed then.
    virtual Result<void> set(std::uint32_t active) = 0;
};

struct GpioEdge {
    bool active = false;  // the level after it, as the kernel read it: a little later than `at`
    hal::TimePoint at;    // when the interrupt came
    std::uint32_t lost =
        0;  // at least so many edges, before this one or right after it, that the kernel could not keep
};

class GpioInput {
  public:
    virtual ~GpioInput() = default;
    [[nodiscard]] virtual int fd() const = 0;  // readable while an edge waits
    // One thread. Appends what waits, in order; does not block. Fails with disconnected or io.
    virtual Result<void> read(std::vector<GpioEdge>& into) = 0;
    // The level now. Fails with disconnected: the only sign of a chip that went away.
    [[nodiscard]] virtual Result<bool> active() = 0;
};

enum class GpioEdges : std::uint8_t { both, activations };

// Blocks for the chips' open. All lines are off when it returns, whatever it returns. 1 to 32 lines.
// Fails with not_found (chip or line; says what there is), busy (says who holds it), invalid_argument (a label that two
// chips have, a line that is named twice), io.
Result<std::unique_ptr<GpioOutputs>> request_outputs(const std::vector<GpioLine>& lines);
Result<std::unique_ptr<GpioInput>> request_input(const GpioLine& line, GpioEdges edges);

[[nodiscard]] std::string gpiod_version();

// What both generations share.
namespace gpio {
[[nodiscard]] std::vector<std::string> chip_paths();  // /dev/gpiochip*, in the order of their numbers
[[nodiscard]] std::string name_of(const GpioLine& line);
[[nodiscard]] int offset_of(const std::string& line);  // -1: not digits alone
tl::unexpected<Error> no_chip(const GpioLine& line, const std::string& there_are, bool some_denied);
tl::unexpected<Error> two_chips(const GpioLine& line, const std::string& one, const std::string& other);
tl::unexpected<Error> no_line(const GpioLine& line);
tl::unexpected<Error> named_twice(const GpioLine& line);
tl::unexpected<Error> failed(const GpioLine& line, const char* what, int error, const std::string& holder = {});
}  // namespace gpio

}  // namespace hord::drivers
