#include "drivers/libcamera/camera_host.h"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <mutex>
#include <utility>
#include <vector>

#include <poll.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "drivers/libcamera/camera_wire.h"

namespace hord::drivers {
namespace {

constexpr int kBetweenLooksMs = 100;  // for a camera that went away

// What the camera's thread tells. Frames may come before the answer is out: they are told behind it. The other end
// reads at once, and a camera has few buffers: there is always room.
class Notes final : public CameraPort::Listener {
  public:
    void on_camera_frame(const CameraFrame& frame) noexcept override { tell({CameraNote::What::frame, frame}); }
    void on_camera_gone() noexcept override { tell({}); }
    void answer_is_out() {
        const std::scoped_lock lock(mutex_);
        open_ = true;
        for (const CameraNote& note : early_) send(note);
    }

  private:
    void tell(const CameraNote& note) noexcept {
        const std::scoped_lock lock(mutex_);
        if (open_) send(note);
        else early_.push_back(note);
    }
    static void send(const CameraNote& note) noexcept {
        [[maybe_unused]] const auto sent = ::send(kCameraSocket, &note, sizeof note, MSG_DONTWAIT | MSG_NOSIGNAL);
    }

    std::mutex mutex_;
    bool open_ = false;
    std::vector<CameraNote> early_;
};

[[noreturn]] void end_without_it(Notes& notes) {
    notes.on_camera_gone();
    ::_exit(0);
}

void stream(CameraDevice& camera, Notes& notes) {
    for (;;) {
        pollfd ready{kCameraSocket, POLLIN, 0};
        const int polled = ::poll(&ready, 1, kBetweenLooksMs);
        if (!camera.is_there()) end_without_it(notes);
        if (polled <= 0) continue;
        std::uint32_t buffer = 0;
        const ssize_t count = ::recv(kCameraSocket, &buffer, sizeof buffer, MSG_DONTWAIT);
        if (count < 0 && (errno == EAGAIN || errno == EINTR)) continue;
        if (count != static_cast<ssize_t>(sizeof buffer)) return;  // the station stopped, or is gone
        if (!camera.queue(buffer)) end_without_it(notes);
    }
}

}  // namespace

int host_camera(int argc, char** argv, const std::function<std::unique_ptr<CameraDevice>(CameraRequest)>& open) {
    // A signal to the service is for the station; this process ends when the station has closed the socket, or is gone.
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    for (const int signal : {SIGTERM, SIGINT, SIGHUP, SIGPIPE}) std::signal(signal, SIG_IGN);
    const auto order = camera_order({argv + std::min(argc, 1), argv + argc});
    if (!order) return 2;
    const auto camera = open(order->request);
    if (order->ask == CameraAsk::look) {
        const auto format = camera->look();
        send_answer(kCameraSocket,
                    format ? Result<CameraAnswer>(CameraAnswer{.format = *format}) : tl::unexpected(format.error()));
        return 0;
    }
    Notes notes;
    const auto buffers = camera->start(notes);
    if (!buffers) {
        send_answer(kCameraSocket, tl::unexpected(buffers.error()));
        return 0;
    }
    if (!send_answer(kCameraSocket, CameraAnswer{.buffers = *buffers})) return 0;
    notes.answer_is_out();
    stream(*camera, notes);
    if (camera->is_there()) camera->stop();
    ::_exit(0);
}

}  // namespace hord::drivers
