// The station's side of a camera that another process (hord-camera, hord-genicam) holds. The buffers are shared memory.
// A thread of this process reports the frames; it has the scheduling policy of the thread that calls start().
//
// Each look() and each start() begins a new process. When it ends, the camera is lost, and the loss says how it ended.
// A process that does not answer or does not end in time is killed.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "drivers/camera_process/camera_port.h"
#include "drivers/hal/listed_camera.h"

namespace hord::drivers {

// `name` in the running program's folder, else in the package's.
std::filesystem::path camera_program(const std::string& name);

// Starts nothing yet. look() and start() also fail with not_found (no such program) and io (no answer within
// `patience`).
std::unique_ptr<CameraPort> open_camera_process(std::string request, std::filesystem::path program,
                                                hal::Duration patience = std::chrono::seconds(20));

// The cameras that `program` could hold. Takes none that another program holds. Waits for `patience` at most. Fails
// with not_found (no such program), io.
Result<std::vector<hal::ListedCamera>> list_cameras(const std::string& request, const std::filesystem::path& program,
                                                    hal::Duration patience = std::chrono::seconds(20));

}  // namespace hord::drivers
