// The calibration that a station decodes its sensor's raw frames with: read, checked against the sensor, and against
// the one before.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>

#include "algo/frame/grid_decoder.h"
#include "calib/files/grid_toml.h"
#include "common/result.h"
#include "drivers/hal/sensor.h"

namespace hord::firmware {

struct ActiveCalibration {
    calib::GridFile file;
    std::uint32_t crc32 = 0;                           // of the file's text: its identity in the registers
    std::shared_ptr<const algo::GridDecoder> decoder;  // to be copied, one a thread

    // Since it was made, now; 0 where the date is of the future, none where it cannot be read.
    [[nodiscard]] std::optional<std::uint32_t> age_s() const;
};

// Reads `file` and makes the decoder of bins_i x bins_j bins. `kept` is where the calibration in use outlives a restart
// (empty: nowhere): a worse one of the same camera does not take its place (calib/files/accept_calibration.h). Fails,
// naming the file and the cure, as calib::read_grid does; with invalid_argument when its frames are not of the sensor's
// size; with `refused` when it is worse; with io when it cannot be kept.
Result<ActiveCalibration> use_calibration(const std::filesystem::path& file, const std::filesystem::path& kept,
                                          const hal::SensorFormat& format, int bins_i, int bins_j);

}  // namespace hord::firmware
