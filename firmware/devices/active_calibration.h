// The calibration for decoding the sensor's raw frames, checked against the sensor and the previous calibration.
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
    std::filesystem::path path;
    calib::GridFile file;
    std::uint32_t crc32 = 0;  // of the file's text; identifies the calibration in the registers
    std::shared_ptr<const algo::GridDecoder> decoder;  // each thread copies it

    // Age at present; 0 for a date in the future, none for an unreadable date.
    [[nodiscard]] std::optional<std::uint32_t> age_s() const;
};

// Reads `file` and makes the decoder of bins_i x bins_j bins. Fails as calib::read_grid and GridDecoder::create do.
Result<ActiveCalibration> read_calibration(const std::filesystem::path& file, int bins_i, int bins_j);

// Whether it can be used with these frames. `kept` is the copy of the calibration in use (empty: none): a worse one of
// the same camera does not replace it (calib/files/accept_calibration.h). Writes nothing. Fails with invalid_argument
// (not the sensor's frame size) and refused (worse).
Result<void> check_calibration(const ActiveCalibration& read, const std::filesystem::path& kept,
                               const hal::SensorFormat& format);

// Told, not refused: the calibration in use before, `kept`, names another camera. None: the same, or none can be read.
std::optional<Error> other_camera(const ActiveCalibration& read, const std::filesystem::path& kept);

// The file of the calibration in use.
std::filesystem::path kept_calibration(const std::filesystem::path& state_folder);  // empty: nothing is kept

}  // namespace hord::firmware
