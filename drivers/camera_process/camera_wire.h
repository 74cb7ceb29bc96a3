// The protocol between the station (camera_process.h) and the process that holds its camera (camera_host.h), on a pair
// of SOCK_SEQPACKET sockets. The process's arguments are the command. Its first message is the answer, as JSON, with
// the buffers' descriptors; then it sends CameraEvents and receives the numbers of buffers to fill again, or
// kTriggerOrder. Both ends are of the same package version.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "drivers/camera_process/camera_host.h"

namespace hord::drivers {

struct CameraEvent {
    enum class What : std::uint32_t { frame, gone, edge } what = What::gone;
    CameraFrame frame{};
    CameraEdge edge{};
    std::array<char, 160> why{};  // of gone; ends with a zero
};
static_assert(std::is_trivially_copyable_v<CameraEvent>);

constexpr std::uint32_t kTriggerOrder = 0xFFFF'FFFF;

enum class CameraCommand : std::uint8_t { look, start, list };
struct CameraAnswer {
    CameraFormat format{};                     // of look
    std::vector<CameraBuffer> buffers{};       // of start; the receiver closes the descriptors
    std::vector<hal::ListedCamera> cameras{};  // of list
};

// The arguments after the program's name. `request` is the driver's options as text; only the driver reads it.
std::vector<std::string> camera_arguments(CameraCommand command, const std::string& request);
struct CameraArguments {
    CameraCommand command;
    std::string request;
};
std::optional<CameraArguments> parse_camera_arguments(
    const std::vector<std::string>& arguments);  // none: invalid arguments

bool send_answer(int socket, const Result<CameraAnswer>& answer);
// Waits for `patience` at most. None: no answer, the other end is closed, or the answer is malformed.
std::optional<Result<CameraAnswer>> receive_answer(int socket, hal::Duration patience);

}  // namespace hord::drivers
