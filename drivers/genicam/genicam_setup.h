// A GenICam camera, set up as the configuration says: before its first frame.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "drivers/camera_process/camera_port.h"
#include "drivers/genicam/aravis.h"
#include "drivers/genicam/genicam_options.h"
#include "drivers/genicam/gvcp_events.h"

namespace hord::drivers {

constexpr int kEthernetMtu = 1500;

// What was agreed with the camera, whose control is held as long as `camera` lives.
struct GenicamSetup {
    ArvOwned<ArvCamera> camera;
    std::string name;  // for messages
    CameraFormat format;
    std::size_t payload = 0;      // bytes of a frame
    std::array<int, 4> region{};  // x, y, width and height
    ArvPixelFormat pixel_format = 0;
    int packet_bytes = 0;             // 0: not a GigE camera
    std::optional<InputEdges> input;  // of the barrier

    [[nodiscard]] ArvDevice* device() const { return arv_camera_get_device(camera.get()); }
};

// Finds the camera, takes its control and sets it up. Fails as take_genicam_camera() and set_feature(), and with
// invalid_argument (a pixel format of another depth), unsupported (frames of another size than the samples, a smaller
// socket buffer than the configuration wants), refused (packets, trigger, length of the light), io.
Result<GenicamSetup> set_up_genicam(const GenicamSensorOptions& options);

// The name of the exposure time, us, as this camera has it.
const char* exposure_feature(ArvDevice* device);

}  // namespace hord::drivers
