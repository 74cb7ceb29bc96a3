#include "drivers/gpio/gpio_listing.h"

#include <cerrno>
#include <cstring>

#include <gpiod.h>

#include "common/device_access.h"
#include "drivers/gpio/gpio_chip.h"

namespace hord::drivers {

std::vector<ListedChip> list_gpio_chips(const std::filesystem::path& dev) {
    std::vector<ListedChip> chips;
    for (const std::string& path : gpio::chip_paths(dev)) {
        ListedChip& listed = chips.emplace_back();
        listed.path = path;
        errno = 0;
        const gpio::Chip chip(gpiod_chip_open(path.c_str()));
        const auto names = chip ? gpio::names_of(chip.get()) : std::nullopt;
        if (!names) {
            const int error = errno;
            const bool denied = error == EACCES || error == EPERM;
            listed.problem = std::string("cannot be read: ") + std::strerror(error);
            listed.cure = denied ? common::access_cure(path) : "look at the kernel's log";
            continue;
        }
        listed.label = names->label;
        listed.lines = gpio::lines_of(chip.get());
    }
    return chips;
}

}  // namespace hord::drivers
