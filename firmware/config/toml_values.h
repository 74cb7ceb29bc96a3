// Values that several sections of the configuration have.
#pragma once

#include <cmath>
#include <string>
#include <string_view>

#include "common/toml_fields.h"
#include "firmware/core/core_config.h"

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

inline void host(common::TomlTable& table, std::string_view key, std::string& value) {
    table.text(key, value);
    if (value.empty()) table.problem(key, "is empty", "give a host name or an address");
}

}  // namespace hord::firmware
