// A camera that another process holds: the station's side. The buffers' memory is shared; frames are told by a thread
// of this process, which takes the policy of the thread that starts the camera.
//
// The process is started for look(), and anew for every start(). One that ends, in whatever way, is a camera that is
// gone; one that does not answer, or does not end when it should, is killed.
#pragma once

#include <filesystem>
#include <memory>

#include "drivers/libcamera/camera_port.h"

namespace hord::drivers {

// hord-camera: beside the running program, else where the package puts it.
std::filesystem::path camera_program();

// Starts nothing yet. look() and start() fail with not_found where there is no such program, and with io where it says
// nothing within `patience`.
std::unique_ptr<CameraPort> open_camera_process(CameraRequest request, std::filesystem::path program = camera_program(),
                                                hal::Duration patience = std::chrono::seconds(20));

std::string libcamera_version();  // that this was built for

}  // namespace hord::drivers
