#include "common/regular_file.h"

#include <system_error>

namespace hord::common {

namespace fs = std::filesystem;

const char* name_of_irregular(fs::file_type type) {
    switch (type) {
        case fs::file_type::block:
        case fs::file_type::character: return "a device";
        case fs::file_type::fifo: return "a pipe";
        case fs::file_type::socket: return "a socket";
        case fs::file_type::directory: return "a folder";
        default: return nullptr;
    }
}

Result<void> check_regular(const fs::path& file, const std::string& cure) {
    std::error_code error;
    const char* const what = name_of_irregular(fs::status(file, error).type());
    if (what == nullptr) return {};
    return fail(ErrorCode::refused, file.string() + " is " + what + ", not a regular file", cure);
}

}  // namespace hord::common
