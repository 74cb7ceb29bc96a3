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
    reference,    // hordctl learn
    calibration,  // hordctl calibrate
    recipe,
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

}  // namespace hord::common
