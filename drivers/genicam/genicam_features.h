// GenICam features by their standard names, checked against the camera's description.
#pragma once

#include <string>

#include "drivers/genicam/aravis.h"

namespace hord::drivers {

// Sets a feature from text: a number, "true" or "false", an entry of an enumeration, a string; "true" executes a
// command. Fails with unsupported (no such feature: names the nearest one), invalid_argument (the value: names the
// range or the entries), refused (the camera does not take it).
Result<void> set_feature(ArvDevice* device, const std::string& name, const std::string& value);

[[nodiscard]] bool has_feature(ArvDevice* device, const char* name);

}  // namespace hord::drivers
