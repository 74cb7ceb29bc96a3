// Why a device's file may not be opened.
#pragma once

#include <string>

namespace hord::common {

// For people: which group's members may open the file at `path`, and how to join it.
std::string access_cure(const std::string& path);

}  // namespace hord::common
