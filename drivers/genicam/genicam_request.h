// The options as text, from the station to hord-genicam.
#pragma once

#include <optional>
#include <string>

#include "drivers/genicam/genicam_options.h"

namespace hord::drivers {

std::string request_of(const GenicamSensorOptions& options);
std::optional<GenicamSensorOptions> parse_genicam_request(const std::string& request);  // none: malformed

}  // namespace hord::drivers
