// The process that holds a camera for the station: the body of the program hord-camera and of the tests' replacements.
//
// Why a process: libcamera does not survive every loss of a camera
// (docs/adr/0005-libcamera-in-a-process-of-its-own.md). Here it may crash, hang or spin; for the station the camera is
// lost, and it starts the next process.
#pragma once

#include <functional>
#include <memory>

#include "drivers/libcamera/camera_device.h"
#include "drivers/libcamera/libcamera_options.h"

namespace hord::drivers {

constexpr int kCameraSocket = 3;  // the process inherits it

// Answers on kCameraSocket and streams until the other end closes it. When the camera is gone it calls _exit(), without
// destructors. Returns the exit status: 0, or 2 for arguments that are not those of camera_wire.h.
int host_camera(int argc, char** argv,
                const std::function<std::unique_ptr<CameraDevice>(LibcameraSensorOptions)>& open);

}  // namespace hord::drivers
