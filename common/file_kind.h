// What a file is that was given in place of another.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>

#include "common/result.h"

namespace hord::common {

enum class FileKind : std::uint8_t {
    unknown,
    image,
    reference,      // hordctl learn
    calibration,    // hordctl calibrate
    recipe,         // from here on: what people write
    configuration,  // hordd.toml
    page,           // page.toml
    mqtt,           // mqtt.toml
    scene,          // of the simulated cell
    stations,       // of hord-page --stations
    tilts,          // of hordctl calibrate
};

// By a file's first bytes.
FileKind kind_of(std::string_view bytes);

// Fails with invalid_argument if the file is of another kind than `wanted`: names both, and where it belongs. Files of
// unknown kind, and what is no file that can be read, are left to the reader.
Result<void> require_kind(const std::filesystem::path& file, FileKind wanted);
// The same for a file's bytes.
Result<void> require_kind(std::string_view bytes, std::string_view name, FileKind wanted);

// Fails with refused if the file, which is to be written, holds what people write: recipe, configuration, scene, list.
Result<void> refuse_hand_written(const std::filesystem::path& file);

}  // namespace hord::common
