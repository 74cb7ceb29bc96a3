// The folders that a configuration names, as they are on this machine now.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common/result.h"
#include "firmware/config/config.h"

namespace hord::firmware {

// A sentence for each folder but those of check_sources(): that this user may read or write it, or that the station
// will create it. Creates and writes nothing. Fails with io: all folders that cannot be used, one a line with its key
// and cure. Files of recipes and calibrations are for their readers to check.
Result<std::vector<std::string>> check_folders(const Config& config);

// What to do about a folder of a disk or share that is mounted after the service starts. Names the folder itself, also
// where the configuration names a link to it.
std::string mounted_late(const std::filesystem::path& folder);

// The same for the folders without which nothing can start: those of recorded frames and of scenes.
Result<std::vector<std::string>> check_sources(const Config& config);

}  // namespace hord::firmware
