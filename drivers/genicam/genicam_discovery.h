// Which GenICam camera.
#pragma once

#include <string>

#include "drivers/genicam/aravis.h"

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

}  // namespace hord::drivers
