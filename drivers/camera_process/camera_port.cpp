#include "drivers/camera_process/camera_port.h"

#include <algorithm>

namespace hord::drivers {

std::string list_of(std::span<const std::string> names) {
    std::string out;
    for (const std::string& name : names) out += (out.empty() ? "" : ", ") + name;
    return out.empty() ? "none" : out;
}

std::string one_line(std::string text) {
    std::ranges::replace_if(
        text, [](char letter) { return static_cast<unsigned char>(letter) < 0x20 || letter == 0x7F; }, ' ');
    return text;
}

Result<GreyFormat> choose_grey_format(const std::string& camera, std::span<const std::string> there,
                                      std::span<const GreyFormat> known, int bits, const std::string& cure) {
    std::string wanted;
    for (const GreyFormat& format : known) {
        if (format.bits != bits) continue;
        wanted += (wanted.empty() ? "" : " or ") + format.name;
        if (std::ranges::find(there, format.name) != there.end()) return format;
    }
    if (wanted.empty())
        return fail(ErrorCode::unsupported, camera + ": no format with " + std::to_string(bits) + " bits is known",
                    "use 8, 10, 12 or 16");
    return fail(ErrorCode::unsupported, camera + " has no " + wanted + " frames; it has " + list_of(there), cure);
}

}  // namespace hord::drivers
