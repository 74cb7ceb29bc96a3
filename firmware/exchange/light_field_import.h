// Light fields and raw frames of other programs as frames with a geometry note. What is read: docs/exchange.md.
#pragma once

#include <filesystem>
#include <string>

#include "common/frame.h"
#include "common/result.h"
#include "drivers/files/frame_geometry.h"

namespace hord::firmware {

struct Imported {
    Frame frame;
    drivers::FrameGeometry geometry;
    std::string from;  // for people: "LFToolbox, colour as the mean of red, green and blue"
};

// A file, or a folder of PlenoptiCam's viewpoints. Fails with not_found, unreadable, unsupported, invalid_argument (a
// light field beyond the limits of algo/frame/extents.h); names the file and what is supported.
Result<Imported> import_light_field(const std::filesystem::path& path);

}  // namespace hord::firmware
