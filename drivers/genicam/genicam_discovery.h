// Which GenICam camera.
#pragma once

#include <string>
#include <vector>

#include "drivers/camera_process/camera_port.h"
#include "drivers/genicam/aravis.h"
#include "drivers/hal/listed_camera.h"

namespace hord::drivers {

// Finds the camera whose serial number, user-defined name, address, hardware address or Aravis id is `wanted`; empty:
// the only one. Takes its control. Waits about a second for the cameras' answers. Fails with not_found (lists the
// cameras), invalid_argument (several match: lists them), busy (another program controls it), unsupported (its XML),
// io.
struct TakenCamera {
    ArvOwned<ArvCamera> camera;
    std::string name;  // for messages
};
Result<TakenCamera> take_genicam_camera(const std::string& wanted);

// All cameras, with their formats and trigger sources. A camera that no program controls is opened for that, which
// takes its control for a moment; one that is controlled is left alone. Fails with io.
Result<std::vector<hal::ListedCamera>> list_genicam_cameras();

// PixelFormat's names (PFNC, and GigE Vision's older packed ones) of grey samples, the preferred one of each depth
// first.
const std::vector<GreyFormat>& genicam_formats();
int genicam_bits(const std::string& format);  // 0: not one of them

}  // namespace hord::drivers
