// The configuration's sections of devices. Problems go to the table's list.
#pragma once

#include <filesystem>

#include "common/toml_fields.h"
#include "firmware/config/config.h"

namespace hord::firmware {

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
