// Which camera of libcamera's, and which of its formats.
#pragma once

#include <span>
#include <string>

#include "drivers/camera_process/camera_port.h"

namespace hord::drivers {

// Of the grey format of this name; 0: it is none.
int libcamera_bits(const std::string& format);

// The best of `available` for grey samples of `bits`: unpacked, then packed, then colour (with `green`). Fails as
// choose_grey_format() does.
Result<GreyFormat> choose_libcamera_format(const std::string& camera, std::span<const std::string> available, int bits,
                                           bool green = false);

// The id of the wanted camera; empty: the only one. Fails with not_found (names the request and lists the cameras) and
// invalid_argument (none was named and there are several).
Result<std::string> choose_camera(std::span<const std::string> available, const std::string& wanted);

}  // namespace hord::drivers
