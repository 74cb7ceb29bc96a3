#include "common/whole_file.h"

#include <fstream>
#include <string>
#include <system_error>

namespace hord::common {

namespace fs = std::filesystem;

Result<void> write_whole(const fs::path& file, std::span<const std::uint8_t> bytes) {
    const fs::path folder = file.parent_path();
    if (std::error_code error; !folder.empty() && !fs::is_directory(folder, error)) {
        return fail(ErrorCode::not_found, "the folder " + folder.string() + " does not exist", "create it first");
    }
    const fs::path unfinished = file.string() + ".part";
    std::ofstream out(unfinished, std::ios::binary);
    out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    out.close();
    std::error_code error;
    if (out) fs::rename(unfinished, file, error);
    if (out && !error) return {};
    const std::string why = error ? " (" + error.message() + ")" : "";
    fs::remove(unfinished, error);
    return fail(ErrorCode::io, file.string() + " cannot be written" + why,
                "check that its folder may be written to and has space");
}

}  // namespace hord::common
