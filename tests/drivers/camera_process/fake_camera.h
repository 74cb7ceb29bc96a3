// A camera without a library, controlled by a test. It runs free on its own thread, as libcamera completes requests, or
// by software trigger.
#pragma once

#include <array>
#include <condition_variable>
#include <cstring>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "drivers/camera_process/camera_port.h"

namespace hord::drivers {

// The state of the camera, shared by the test and the port; outlives the port.
struct FakeCamera {
    explicit FakeCamera(const hal::Clock& c) : clock(c) {}
    const hal::Clock& clock;
    std::mutex mutex;
    std::condition_variable woken;
    bool there = true;
    bool silent = false;  // keeps its buffers and delivers nothing
    std::string pixel_format = "R8";
    int bits = 8;
    SampleLayout layout = SampleLayout::plain;
    bool tells_start = true;
    std::optional<int> triggers;                         // frames that were triggered and not made yet; none: runs free
    int lose = 0;                                        // frames that never arrive
    std::optional<std::array<std::uint8_t, 3>> colours;  // of every pixel; the middle one is replaced by 16 y + x
    int width_px = 12, height_px = 6;
    std::ptrdiff_t stride_bytes = 16;
    std::size_t short_by = 0;  // missing bytes of each frame
    bool corrupt = false;
    std::deque<std::uint32_t> queued;  // in order
    int queue_calls = 0;
    std::uint32_t sequence = 0;
    int streams = 0;  // starts minus stops

    void be_there(bool is) {
        const std::scoped_lock lock(mutex);
        there = is;
        woken.notify_all();
    }
    template <class Change>
    void change(Change apply) {
        const std::scoped_lock lock(mutex);
        apply(*this);
    }
};

class FakeCameraPort final : public CameraPort {
  public:
    FakeCameraPort(std::shared_ptr<FakeCamera> camera, int buffers) : camera_(std::move(camera)), buffers_(buffers) {}
    ~FakeCameraPort() override { stop(); }

    Result<CameraFormat> look() override {
        const std::scoped_lock lock(camera_->mutex);
        if (!camera_->there) return fail(ErrorCode::not_found, "the fake camera is not there", "bring it back");
        return CameraFormat{camera_->width_px,
                            camera_->height_px,
                            {camera_->pixel_format, camera_->bits, camera_->layout},
                            camera_->stride_bytes};
    }

    Result<std::shared_ptr<const Memory>> start(Listener& listener) override {
        if (auto format = look(); !format) return tl::unexpected(format.error());
        struct Held {
            std::vector<std::vector<std::byte>> bytes;
            Memory memory;
        };
        auto held = std::make_shared<Held>();
        const std::size_t size =
            static_cast<std::size_t>(camera_->stride_bytes) * static_cast<std::size_t>(camera_->height_px);
        {
            const std::scoped_lock lock(camera_->mutex);
            camera_->queued.clear();
            for (int k = 0; k < buffers_; ++k) {
                held->bytes.emplace_back(size);
                held->memory.emplace_back(held->bytes.back());
                camera_->queued.push_back(static_cast<std::uint32_t>(k));
            }
            camera_->sequence = 0;
            ++camera_->streams;
            stopping_ = false;
        }
        thread_ = std::thread([this, held, &listener] { run(held->bytes, listener); });
        return std::shared_ptr<const Memory>(held, &held->memory);
    }

    Result<void> queue(std::uint32_t buffer) override {
        const std::scoped_lock lock(camera_->mutex);
        camera_->queued.push_back(buffer);
        ++camera_->queue_calls;
        return {};
    }

    Result<void> trigger() override {
        const std::scoped_lock lock(camera_->mutex);
        if (camera_->triggers) ++*camera_->triggers;
        return {};
    }

    void stop() override {
        if (!thread_.joinable()) return;
        {
            const std::scoped_lock lock(camera_->mutex);
            stopping_ = true;
            --camera_->streams;
        }
        camera_->woken.notify_all();
        thread_.join();
    }

  private:
    void run(std::vector<std::vector<std::byte>>& bytes, Listener& listener) {
        std::unique_lock lock(camera_->mutex);
        for (;;) {
            hal::TimePoint began = camera_->clock.now();
            camera_->woken.wait_for(lock, std::chrono::milliseconds(2),
                                    [this] { return stopping_ || !camera_->there; });
            if (stopping_) return;
            if (!camera_->there) return listener.on_camera_gone("was unplugged", {});
            if (camera_->silent || camera_->queued.empty() || camera_->triggers == 0)
                continue;  // waits for a buffer, so that a slow test sees no gap
            ++camera_->sequence;
            if (camera_->triggers) {
                --*camera_->triggers;
                began = camera_->clock.now();
            }
            if (camera_->lose > 0) {
                --camera_->lose;
                continue;
            }
            const std::uint32_t buffer = camera_->queued.front();
            camera_->queued.pop_front();
            std::memset(bytes[buffer].data(), static_cast<int>(camera_->sequence & 0x7F), bytes[buffer].size());
            if (camera_->colours) paint(bytes[buffer]);
            CameraFrame frame;
            frame.buffer = buffer;
            frame.sequence = camera_->sequence;
            frame.stamp = camera_->tells_start ? began : camera_->clock.now();
            frame.stamp_of_start = camera_->tells_start;
            frame.bytes_used = bytes[buffer].size() - camera_->short_by;
            frame.corrupt = camera_->corrupt;
            frame.stamp_error_known = true;
            lock.unlock();
            listener.on_camera_frame(frame);
            lock.lock();
        }
    }

    void paint(std::vector<std::byte>& frame) const {
        for (int y = 0; y < camera_->height_px; ++y) {
            for (int x = 0; x < camera_->width_px; ++x) {
                std::byte* const pixel = frame.data() + y * camera_->stride_bytes + 3 * x;
                for (std::size_t k = 0; k < 3; ++k)
                    pixel[k] = std::byte(k == 1 ? static_cast<std::uint8_t>(16 * y + x) : (*camera_->colours)[k]);
            }
        }
    }

    std::shared_ptr<FakeCamera> camera_;
    int buffers_;
    bool stopping_ = false;
    std::thread thread_;
};

}  // namespace hord::drivers
