#include "drivers/gpio/gpio_lines.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>

namespace hord::drivers::gpio {

std::vector<std::string> chip_paths() {
    constexpr std::string_view kPrefix = "gpiochip";
    std::vector<std::string> paths;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator("/dev", error)) {
        if (entry.path().filename().string().starts_with(kPrefix) && !entry.is_symlink(error))
            paths.push_back(entry.path().string());
    }
    std::ranges::sort(paths, {}, [](const std::string& path) { return std::pair(path.size(), path); });
    return paths;
}

std::string name_of(const GpioLine& line) { return "GPIO line \"" + line.line + "\" of chip \"" + line.chip + "\""; }

int offset_of(const std::string& line) {
    int offset = -1;
    const auto read = std::from_chars(line.data(), line.data() + line.size(), offset);
    return read.ec == std::errc() && read.ptr == line.data() + line.size() && offset >= 0 ? offset : -1;
}

tl::unexpected<Error> no_chip(const GpioLine& line, const std::string& labels, bool some_denied) {
    return fail(some_denied && labels.empty() ? ErrorCode::io : ErrorCode::not_found,
                name_of(line) + ": there is no such chip; " + (some_denied ? "some may not be opened; " : "") +
                    (labels.empty() ? "none was found" : "there are: " + labels),
                some_denied ? "give the service's user the GPIO chips (udev), or run as root"
                            : "check the board's driver, and the label that gpiodetect prints");
}

tl::unexpected<Error> two_chips(const GpioLine& line, const std::string& one, const std::string& other) {
    return fail(ErrorCode::invalid_argument, name_of(line) + ": " + one + " and " + other + " have this label, both",
                "name the chip by its path");
}

tl::unexpected<Error> no_line(const GpioLine& line) {
    return fail(ErrorCode::not_found, name_of(line) + " does not exist",
                "use a name or an offset that gpioinfo prints");
}

tl::unexpected<Error> named_twice(const GpioLine& line) {
    return fail(ErrorCode::invalid_argument, name_of(line) + " is named twice", "give each channel a line of its own");
}

tl::unexpected<Error> failed(const GpioLine& line, const char* what, int error, const std::string& holder) {
    if (error == EBUSY) {
        return fail(
            ErrorCode::busy,
            name_of(line) + ": " + what + ": " + (holder.empty() ? "it is in use" : "\"" + holder + "\" holds it"),
            "stop the program or the kernel driver that holds it (gpioinfo), or name another line");
    }
    const bool gone = error == ENODEV || error == ENXIO;
    return fail(gone ? ErrorCode::disconnected : ErrorCode::io,
                name_of(line) + ": " + what + ": " + (gone ? "the chip is gone" : std::strerror(error)),
                gone ? "check its cable and its driver" : "look at the kernel's log");
}

}  // namespace hord::drivers::gpio
