#include "drivers/camera_process/camera_host.h"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <mutex>
#include <utility>
#include <vector>

#include <poll.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "drivers/camera_process/camera_wire.h"

namespace hord::drivers {
namespace {

constexpr int kCheckEveryMs = 100;  // interval of is_there()

// Sends the camera's events. Those that come before the answer was sent are kept until then. The socket is never full:
// the other end reads at once, and a camera has few buffers.
class EventSender final : public CameraPort::Listener {
  public:
    void on_camera_frame(const CameraFrame& frame) noexcept override {
        add({.what = CameraEvent::What::frame, .frame = frame});
    }
    void on_camera_edge(const CameraEdge& edge) noexcept override {
        add({.what = CameraEvent::What::edge, .edge = edge});
    }
    void on_camera_gone(std::string_view why, std::string_view) noexcept override {
        CameraEvent event;
        std::ranges::copy(why.substr(0, event.why.size() - 1), event.why.begin());
        add(event);
    }
    void answer_sent() {
        const std::scoped_lock lock(mutex_);
        answered_ = true;
        for (const CameraEvent& event : early_) send(event);
    }

  private:
    void add(const CameraEvent& event) noexcept {
        const std::scoped_lock lock(mutex_);
        if (answered_) send(event);
        else early_.push_back(event);
    }
    static void send(const CameraEvent& event) noexcept {
        [[maybe_unused]] const auto sent = ::send(kCameraSocket, &event, sizeof event, MSG_DONTWAIT | MSG_NOSIGNAL);
    }

    std::mutex mutex_;
    bool answered_ = false;
    std::vector<CameraEvent> early_;
};

[[noreturn]] void exit_without_camera(EventSender& events, const std::string& why) {
    events.on_camera_gone(why, {});
    ::_exit(0);
}

void stream(CameraDevice& camera, EventSender& events) {
    for (;;) {
        pollfd ready{kCameraSocket, POLLIN, 0};
        const int polled = ::poll(&ready, 1, kCheckEveryMs);
        if (!camera.is_there()) exit_without_camera(events, camera.why_gone());
        if (polled <= 0) continue;
        std::uint32_t buffer = 0;
        const ssize_t count = ::recv(kCameraSocket, &buffer, sizeof buffer, MSG_DONTWAIT);
        if (count < 0 && (errno == EAGAIN || errno == EINTR)) continue;
        if (count != static_cast<ssize_t>(sizeof buffer)) return;  // the station stopped the camera, or ended
        const auto done = buffer == kTriggerOrder ? camera.trigger() : camera.queue(buffer);
        if (!done) exit_without_camera(events, done.error().what);
    }
}

}  // namespace

int host_camera(int argc, char** argv,
                const std::function<std::unique_ptr<CameraDevice>(const std::string& request)>& open) {
    // Signals to the service are for the station. This process ends when the station closes the socket or ends.
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    for (const int signal : {SIGTERM, SIGINT, SIGHUP, SIGPIPE}) std::signal(signal, SIG_IGN);
    const auto arguments = parse_camera_arguments({argv + std::min(argc, 1), argv + argc});
    const auto camera = arguments ? open(arguments->request) : nullptr;
    if (!camera) {
        std::fprintf(stderr, "%s: started by the station alone, for its camera; nothing to do here: see hordd(8)\n",
                     argc > 0 ? argv[0] : "");
        return 2;
    }
    if (arguments->command == CameraCommand::look) {
        const auto format = camera->look();
        send_answer(kCameraSocket,
                    format ? Result<CameraAnswer>(CameraAnswer{.format = *format}) : tl::unexpected(format.error()));
        return 0;
    }
    if (arguments->command == CameraCommand::list) {
        auto cameras = camera->list();
        const auto answer = cameras ? Result<CameraAnswer>(CameraAnswer{.cameras = std::move(*cameras)})
                                    : tl::unexpected(cameras.error());
        return send_answer(kCameraSocket, answer) ? 0 : 1;
    }
    EventSender events;
    const auto buffers = camera->start(events);
    if (!buffers) {
        send_answer(kCameraSocket, tl::unexpected(buffers.error()));
        return 0;
    }
    if (!send_answer(kCameraSocket, CameraAnswer{.buffers = *buffers})) return 0;
    events.answer_sent();
    stream(*camera, events);
    if (camera->is_there()) camera->stop();
    ::_exit(0);
}

}  // namespace hord::drivers
