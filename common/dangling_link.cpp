#include "common/dangling_link.h"

#include <system_error>

namespace hord::common {

namespace fs = std::filesystem;

std::string dangling_link(const fs::path& path) {
    std::error_code error;
    for (fs::path at = path; !at.empty(); at = at.parent_path()) {
        if (fs::is_symlink(fs::symlink_status(at, error)) && fs::status(at, error).type() == fs::file_type::not_found)
            return at.string() + " is a symbolic link to " + fs::read_symlink(at, error).string() +
                ", which does not exist";
        if (at == at.parent_path()) break;
    }
    return {};
}

}  // namespace hord::common
