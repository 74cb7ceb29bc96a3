// What the configuration's files say of the frames, before a device is opened and before anything is rendered.
#pragma once

#include <optional>

#include "common/result.h"
#include "drivers/files/recorded_frames.h"
#include "drivers/hal/sensor.h"
#include "firmware/config/config.h"
#include "hal_sim/cell/production.h"

namespace hord::firmware {

// Whether [sensor] names scenes for the simulated cell.
bool has_scene_files(const Config& config);

// The scenes of sensor.scenes, of inspection.macro. Fails as sim::load_production() does, and with invalid_argument
// (scenes of other macro-pixels).
Result<sim::Production> configured_scenes(const Config& config, double good_share);

// Compares what recorded frames note with [inspection]. Fails with invalid_argument.
Result<void> check_geometry(const std::optional<drivers::RecordedFrames::Noted>& noted,
                            const InspectionConfig& inspection);

// The format of the frames that will come: of the recorded frames, of the scenes, or of the simulated parts. None: a
// camera, which says it when it is there. Reads every recorded frame, and keeps none. Fails with invalid_argument,
// not_found and as the files' readers do: the key, each file and a cure.
Result<std::optional<hal::SensorFormat>> expected_format(const Config& config);

}  // namespace hord::firmware
