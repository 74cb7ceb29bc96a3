// The video devices of a machine. Nothing is set and nothing streams.
#pragma once

#include <filesystem>
#include <vector>

#include "drivers/hal/listed_camera.h"

namespace hord::drivers {

// video* in the folder `dev` ("/dev") that capture frames, in the order of their numbers, and those that cannot be
// read. `holder` of one that another program streams from is "another program".
std::vector<hal::ListedCamera> list_v4l2_cameras(const std::filesystem::path& dev);

}  // namespace hord::drivers
