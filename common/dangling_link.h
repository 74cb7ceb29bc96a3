// Symbolic links to nothing: the system's messages about them ("File exists", "No such file") mislead.
#pragma once

#include <filesystem>
#include <string>

namespace hord::common {

// "/data is a symbolic link to /mnt/x, which does not exist": of the path or the nearest of its parents that is one.
// Empty: none is.
std::string dangling_link(const std::filesystem::path& path);

}  // namespace hord::common
