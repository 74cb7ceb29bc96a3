#include "drivers/libcamera/camera_port.h"

#include <algorithm>

namespace hord::drivers {
namespace {

// The formats of a depth, the preferred one first.
struct Known {
    int bits;
    const char* name;
    bool packed = false, green = false;
};
constexpr Known kFormats[] = {{8, "R8"},
                              {10, "R10"},
                              {10, "R10_CSI2P", true},
                              {12, "R12"},
                              {12, "R12_CSI2P", true},
                              {16, "R16"},
                              {8, "BGR888", false, true},
                              {8, "RGB888", false, true}};

std::string list_of(std::span<const std::string> names) {
    std::string out;
    for (const std::string& name : names) out += (out.empty() ? "" : ", ") + name;
    return out.empty() ? "none" : out;
}

}  // namespace

Result<GreyFormat> choose_grey_format(const std::string& camera, std::span<const std::string> there, int bits,
                                      bool green) {
    std::string wanted;
    for (const Known& known : kFormats) {
        if (known.bits != bits || (known.green && !green)) continue;
        wanted += (wanted.empty() ? "" : " or ") + std::string(known.name);
        if (std::ranges::find(there, known.name) != there.end())
            return GreyFormat{known.name, bits, known.packed, known.green};
    }
    if (wanted.empty())
        return fail(ErrorCode::unsupported, camera + ": no format with " + std::to_string(bits) + " bits is known",
                    "use 8, 10, 12 or 16");
    return fail(ErrorCode::unsupported, camera + " has no " + wanted + " frames; it has " + list_of(there),
                "set sensor.bits to what the camera has (cam -c ID -I); of a colour camera's BGR888 or RGB888 frames "
                "sensor.green takes the green samples");
}

Result<std::string> choose_camera(std::span<const std::string> there, const std::string& wanted) {
    if (!wanted.empty()) {
        if (std::ranges::find(there, wanted) != there.end()) return wanted;
        return fail(ErrorCode::not_found, "camera \"" + wanted + "\" is not there; cameras: " + list_of(there),
                    "check its cable and sensor.camera (cam -l)");
    }
    if (there.empty()) return fail(ErrorCode::not_found, "no camera is there", "check its cable; see cam -l");
    if (there.size() > 1) {
        return fail(ErrorCode::invalid_argument, "several cameras are there: " + list_of(there),
                    "say which one in sensor.camera");
    }
    return there.front();
}

}  // namespace hord::drivers
