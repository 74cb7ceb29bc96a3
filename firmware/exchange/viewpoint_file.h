// An image of a viewpoint: one pixel a lenslet.
#pragma once

#include <filesystem>

#include "common/frame.h"
#include "common/result.h"

namespace hord::firmware {

struct Viewpoint {
    Frame frame;
    bool colour = false;  // the mean of red, green and blue
};

// A grey image as drivers::read_frame() reads it, or a TIFF of red, green and blue, 8 or 16 bits each, in strips. Any
// thread. Fails as drivers::read_frame() does.
Result<Viewpoint> read_viewpoint(const std::filesystem::path& file);

}  // namespace hord::firmware
