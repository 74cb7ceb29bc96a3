// Keys that several sections of the configuration have. Problems go to the table's list.
#pragma once

#include <cmath>
#include <string>
#include <string_view>

#include "common/toml_fields.h"
#include "firmware/config/config.h"

namespace hord::firmware {

// A key in milliseconds or microseconds, as its name says, rounded to nanoseconds.
inline void duration(common::TomlTable& table, std::string_view key, Duration& value, double unit_ns, double low,
                     double high) {
    double number = static_cast<double>(value.count()) / unit_ns;
    table.number(key, number, low, high);
    value = Duration(std::llround(number * unit_ns));
}
inline void ms(common::TomlTable& table, std::string_view key, Duration& value, double low, double high) {
    duration(table, key, value, 1e6, low, high);
}
inline void us(common::TomlTable& table, std::string_view key, Duration& value, double low, double high) {
    duration(table, key, value, 1e3, low, high);
}

// A host name or an address, without a port.
void host(common::TomlTable& table, std::string_view key, std::string& value);
// The key "baud": a rate that every serial line has.
void baud(common::TomlTable& table, int& value);

// What would be set and have no effect. A value that is the default is no setting: a file may hold every key.
void refuse(common::TomlTable& table, bool set, std::string_view key, std::string_view cure,
            std::string_view what = "has no effect with this backend");

// Reads a GPIO line from the keys "chip", "line", "active_low" and, for an input, "bias" of `table`.
drivers::GpioLine gpio_line(common::TomlTable& table, bool input);
void check_gpio_line(common::TomlTable& table, const drivers::GpioLine& line);

}  // namespace hord::firmware
