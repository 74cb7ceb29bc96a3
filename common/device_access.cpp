#include "common/device_access.h"

#include <grp.h>
#include <sys/stat.h>

namespace hord::common {

std::string access_cure(const std::string& path) {
    struct stat status {};
    const bool known = ::stat(path.c_str(), &status) == 0;
    const group* const owner = known ? ::getgrgid(status.st_gid) : nullptr;
    const bool may = (status.st_mode & S_IRGRP) != 0 && (status.st_mode & S_IWGRP) != 0;
    if (owner == nullptr || !may || status.st_gid == 0) return "run as root";
    return "join the group " + std::string(owner->gr_name) + " (usermod -aG " + owner->gr_name +
        " USER, then log in again), or run as root";
}

}  // namespace hord::common
