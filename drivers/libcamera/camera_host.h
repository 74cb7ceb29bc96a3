// The process that holds a camera for the station: the whole of the program hord-camera, and of those that tests start
// in its place.
//
// Why a process: libcamera does not survive every loss of a camera
// (docs/adr/0005-libcamera-in-a-process-of-its-own.md). Here it may end, hang or turn in circles; the station's own
// process, its timing thread and its registers know a camera that is lost, and start the next process.
#pragma once

#include <functional>
#include <memory>

#include "drivers/libcamera/camera_device.h"

namespace hord::drivers {

constexpr int kCameraSocket = 3;  // the descriptor that the process is started with

// Answers on kCameraSocket, streams until the other end closes it, and ends with it; exits the process at once, by
// nobody's destructor, when the camera is gone. Returns the process's status: 0, or 2 for what are no arguments of
// camera_wire.h.
int host_camera(int argc, char** argv, const std::function<std::unique_ptr<CameraDevice>(CameraRequest)>& open);

}  // namespace hord::drivers
