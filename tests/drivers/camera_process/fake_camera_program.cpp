// Replaces hord-camera: the request, a word, selects its behaviour. A frame's first pixel is its number, the second one
// the thread's scheduling policy.
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <deque>
#include <mutex>
#include <thread>

#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include "drivers/camera_process/camera_host.h"

namespace {

using namespace hord;
using namespace std::chrono_literals;

class NamedCamera final : public drivers::CameraDevice {
  public:
    explicit NamedCamera(std::string request) : request_(std::move(request)) {}
    ~NamedCamera() override { stop(); }

    Result<std::vector<hal::ListedCamera>> list() override {
        if (request_ == "unsupported") return fail(ErrorCode::io, "no library", "install it");
        if (request_ == "hangs") std::this_thread::sleep_for(1h);
        hal::ListedCamera mono{.name = "mono", .text = "imx\a\n296", .formats = {{"R8", 8, 640, 480, {"640x480"}}}};
        mono.formats.push_back({"R10_CSI2P", 10, 1456, 1088, {"640x480", "1456x1088"}});
        return std::vector{mono, hal::ListedCamera{.name = "colour", .formats = {{"BGR888", 0, 1920, 1080, {}}}}};
    }
    Result<drivers::CameraFormat> look() override {
        if (request_ == "unsupported") return fail(ErrorCode::unsupported, "it has\nBGR888", "set sensor.bits");
        if (request_ == "hangs") std::this_thread::sleep_for(1h);
        if (request_ == "dies-when-looked-at") std::abort();
        if (request_ == "impossible") return drivers::CameraFormat{8, 2, {"R16", 16}, 8};
        return drivers::CameraFormat{8, 2, {"R8", 8}, 8};
    }
    Result<std::vector<drivers::CameraBuffer>> start(drivers::CameraPort::Listener& listener) override {
        std::vector<drivers::CameraBuffer> out;
        for (int k = 0; k < 3; ++k) {
            const int fd = ::memfd_create("buffer", MFD_CLOEXEC);
            if (::ftruncate(fd, 4096) != 0) return fail(ErrorCode::io, "no memory");
            void* const data = ::mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
            data_.push_back(static_cast<unsigned char*>(data));
            out.push_back({fd, 64, request_ == "short-memory" ? 8192U : 16U});
            queued_.push_back(static_cast<std::uint32_t>(k));
        }
        thread_ = std::thread([this, &listener] { run(listener); });
        return out;
    }
    Result<void> queue(std::uint32_t buffer) override {
        if (request_ == "dies") std::abort();  // not by itself: it must have answered before
        if (request_ == "exits") std::_Exit(3);
        const std::scoped_lock lock(mutex_);
        queued_.push_back(buffer);
        return {};
    }
    Result<void> trigger() override { return fail(ErrorCode::io, "refused a trigger"); }
    bool is_there() override { return !(request_ == "unplugged" && made_ >= 3); }
    void stop() override {
        if (!thread_.joinable()) return;
        while (request_ == "does-not-stop") std::this_thread::sleep_for(1h);
        stopping_ = true;
        thread_.join();
    }

  private:
    void run(drivers::CameraPort::Listener& listener) {
        for (; !stopping_; std::this_thread::sleep_for(1ms)) {
            const std::scoped_lock lock(mutex_);
            if (queued_.empty() || (request_ == "unplugged" && made_ == 3)) continue;
            const std::uint32_t buffer = queued_.front();
            queued_.pop_front();
            const int number = ++made_;
            data_[buffer][64] = static_cast<unsigned char>(number);
            data_[buffer][65] = static_cast<unsigned char>(::sched_getscheduler(0));
            drivers::CameraFrame frame;
            frame.buffer = buffer;
            frame.sequence = static_cast<std::uint32_t>(number);
            frame.bytes_used = 16;
            listener.on_camera_frame(frame);
        }
    }

    const std::string request_;
    std::vector<unsigned char*> data_;
    std::mutex mutex_;
    std::deque<std::uint32_t> queued_;
    std::atomic<int> made_ = 0;
    std::atomic<bool> stopping_ = false;
    std::thread thread_;
};

}  // namespace

int main(int argc, char** argv) {
    return hord::drivers::host_camera(argc, argv, [](const std::string& request) {
        return request.empty() ? nullptr : std::make_unique<NamedCamera>(request);
    });
}
