// Arbitrary bytes as the camera process's answer, and as its arguments (a line each).
#include <array>
#include <cstdlib>
#include <sstream>

#include <sys/socket.h>
#include <unistd.h>

#include "common/unique_fd.h"
#include "drivers/camera_process/camera_wire.h"

namespace {

// Both ends stay open: each input is one message, which receive_answer() takes.
struct Ends {
    hord::common::UniqueFd station, camera;
    Ends() {
        std::array<int, 2> ends{};
        if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends.data()) != 0) std::abort();
        station = hord::common::UniqueFd(ends[0]);
        camera = hord::common::UniqueFd(ends[1]);
    }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace hord;
    using namespace hord::drivers;
    static const Ends ends;
    if (::send(ends.camera.get(), data, size, MSG_NOSIGNAL | MSG_DONTWAIT) != static_cast<ssize_t>(size)) std::abort();
    if (const auto answer = receive_answer(ends.station.get(), std::chrono::seconds(1)); answer && *answer) {
        for (const CameraBuffer& buffer : (*answer)->buffers) {
            if (buffer.fd >= 0) std::abort();  // no descriptor was sent
        }
    }
    std::istringstream lines(std::string(reinterpret_cast<const char*>(data), size));
    std::vector<std::string> arguments;
    for (std::string line; std::getline(lines, line);) arguments.push_back(line);
    if (const auto parsed = parse_camera_arguments(arguments); parsed) {
        if (!parse_camera_arguments(camera_arguments(parsed->command, parsed->request))) std::abort();
    }
    return 0;
}
