// Between the station and the process that holds its camera (camera_process.h, camera_host.h): a pair of SOCK_SEQPACKET
// sockets. The request is the process's arguments; its first message is what came of it, as text, with the buffers'
// descriptors; then it sends CameraNotes, and takes numbers of buffers to be filled again. Both ends are of the same
// package.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "drivers/libcamera/camera_device.h"

namespace hord::drivers {

struct CameraNote {
    enum class What : std::uint32_t { frame, gone } what = What::gone;
    CameraFrame frame{};
};
static_assert(std::is_trivially_copyable_v<CameraNote>);

enum class CameraAsk : std::uint8_t { look, start };
struct CameraAnswer {
    CameraFormat format{};                // to look
    std::vector<CameraBuffer> buffers{};  // to start; the descriptors are the receiver's, which closes them
};

// The arguments behind the program's name.
std::vector<std::string> camera_arguments(CameraAsk ask, const CameraRequest& request);
struct CameraOrder {
    CameraAsk ask;
    CameraRequest request;
};
std::optional<CameraOrder> camera_order(
    const std::vector<std::string>& arguments);  // nothing where they are not such arguments

bool send_answer(int socket, const Result<CameraAnswer>& answer);
// Waits so long. Nothing: the other end is gone, or said nothing that can be understood.
std::optional<Result<CameraAnswer>> receive_answer(int socket, hal::Duration patience);

}  // namespace hord::drivers
