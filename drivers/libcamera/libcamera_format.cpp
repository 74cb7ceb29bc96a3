#include "drivers/libcamera/libcamera_format.h"

#include <algorithm>
#include <vector>

namespace hord::drivers {

namespace {

const std::vector<GreyFormat> kGrey{
    {"R8", 8},  {"R10", 10}, {"R10_CSI2P", 10, SampleLayout::mipi}, {"R12", 12}, {"R12_CSI2P", 12, SampleLayout::mipi},
    {"R16", 16}};

}  // namespace

int libcamera_bits(const std::string& format) {
    const auto known = std::ranges::find(kGrey, format, &GreyFormat::name);
    return known == kGrey.end() ? 0 : known->bits;
}

Result<GreyFormat> choose_libcamera_format(const std::string& camera, std::span<const std::string> there, int bits,
                                           bool green) {
    std::vector<GreyFormat> known = kGrey;
    if (green) {
        for (const char* name : {"BGR888", "RGB888"}) known.push_back({name, 8, SampleLayout::green});
    }
    return choose_grey_format(camera, there, known, bits,
                              "set sensor.bits to what the camera has (cam -c ID -I); of a colour camera's BGR888 or "
                              "RGB888 frames sensor.green takes the green samples");
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
