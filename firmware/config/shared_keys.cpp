#include "firmware/config/shared_keys.h"

#include <algorithm>
#include <array>

#include <arpa/inet.h>

namespace hord::firmware {

using common::TomlTable;

void host(TomlTable& table, std::string_view key, std::string& value) {
    table.text(key, value);
    constexpr std::string_view kLetters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-_";
    const std::string cure = "give a host name or an address, as \"192.168.1.20\"; the port has a key of its own";
    if (value.empty()) return table.problem(key, "is empty", "give a host name or an address");
    in6_addr six{};
    in_addr four{};
    if (::inet_pton(AF_INET6, value.substr(0, value.find('%')).c_str(), &six) == 1) return;
    if (value.find_first_not_of("0123456789.") == std::string::npos) {
        if (::inet_pton(AF_INET, value.c_str(), &four) != 1)
            table.problem(key, "is no IPv4 address", "write four numbers from 0 to 255, as \"192.168.1.20\"");
    } else if (value.find_first_not_of(kLetters) != std::string::npos) {
        table.problem(key, "\"" + value + "\" is neither a host name nor an address", cure);
    }
}

void baud(TomlTable& table, int& value) {
    constexpr std::array kRates{1200, 2400, 4800, 9600, 19'200, 38'400, 57'600, 115'200, 230'400, 460'800, 921'600};
    table.integer("baud", value, 1200, 921'600);
    if (std::ranges::find(kRates, value) == kRates.end())
        table.problem("baud", "is no rate of a serial line",
                      "use 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800 or 921600");
}

void refuse(TomlTable& table, bool set, std::string_view key, std::string_view cure, std::string_view what) {
    if (set) table.problem(key, what, cure);
}

drivers::GpioLine gpio_line(TomlTable& table, bool input) {
    drivers::GpioLine line;
    table.text("chip", line.chip);
    table.text("line", line.line);
    table.boolean("active_low", line.active_low);
    if (input) table.choice("bias", {"as-is", "disabled", "pull-up", "pull-down"}, line.bias);
    return line;
}

void check_gpio_line(TomlTable& table, const drivers::GpioLine& line) {
    if (line.chip.empty())
        table.problem("chip", "is missing", "name the GPIO chip by its label, as gpiodetect prints it");
    if (line.line.empty())
        table.problem("line", "is missing", "name the line, or give its offset as \"6\"; see gpioinfo");
}

}  // namespace hord::firmware
