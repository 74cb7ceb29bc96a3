// What differs between libgpiod 1.6 (gpio_chip_v1.cpp) and 2.x (gpio_chip_v2.cpp). The build selects one of the two
// files by the installed version.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "drivers/gpio/gpio_lines.h"
#include "drivers/gpio/gpio_listing.h"

struct gpiod_chip;

namespace hord::drivers::gpio {

inline constexpr const char* kConsumer = "hord";

struct CloseChip {
    void operator()(gpiod_chip* chip) const;
};
using Chip = std::unique_ptr<gpiod_chip, CloseChip>;

// gpiochip* in the folder `dev`, in the order of their numbers.
std::vector<std::string> chip_paths(const std::filesystem::path& dev);

struct ChipNames {
    std::string name, label;
};
std::optional<ChipNames> names_of(gpiod_chip* chip);  // none: errno says why

int find_line(gpiod_chip* chip, const std::string& name);  // its offset; -1: there is none
bool has_line(gpiod_chip* chip, unsigned offset);
std::optional<std::string> holder_of(gpiod_chip* chip, unsigned offset);  // none: free; empty: holder has no name

std::vector<ListedLine> lines_of(gpiod_chip* chip);

// Lines of a chip in one request, off at first. Its chip must outlive it.
class OutputBank {
  public:
    virtual ~OutputBank() = default;
    virtual bool set(std::uint32_t active) = 0;  // bit k: the k-th line. False: errno says why
};

// Null: errno says why. Bit k of `active_low` is the k-th line's. request_line() takes the chip if it succeeds.
std::unique_ptr<OutputBank> request_bank(gpiod_chip* chip, std::span<const unsigned> offsets, std::uint32_t active_low);
std::unique_ptr<GpioInput> request_line(Chip& chip, unsigned offset, const GpioLine& line, GpioEdges edges);

tl::unexpected<Error> failed(const GpioLine& line, const char* what, int error, const std::string& holder = {});

}  // namespace hord::drivers::gpio
