// The configuration's sections of devices, and values that several sections have. Problems go to the table's list.
#pragma once

#include <cmath>
#include <filesystem>
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

// `folder`: relative paths start there.
void read_sensor(common::TomlTable sensor, SensorConfig& value, const std::filesystem::path& folder);

// These also check the devices against the timing in `core`; read [line] and [timing] first. [rejector] and [strobe]
// hold keys of the core as well.
void read_rejector(common::TomlTable rejector, RejectorConfig& value, CoreConfig& core);
// `seen_by`: the configuration of the camera. If the camera switches the light, its output and the length of the light
// are written there. Null: [sensor] was misread, and what these devices need of the camera is not checked.
void read_strobe(common::TomlTable strobe, StrobeConfig& value, CoreConfig& core, SensorConfig* seen_by);
void read_part_sensor(common::TomlTable sensor, PartSensorConfig& value, const CoreConfig& core, SensorConfig* seen_by);

}  // namespace hord::firmware
