// The writing end of a v4l2loopback device: sends the frames of the simulated sensor.
#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "common/frame.h"

namespace hord::rig {

class VideoOut {
  public:
    // 8-bit GREY frames. Throws std::runtime_error when the device is absent or refuses this format.
    VideoOut(std::string device, int width_px, int height_px);
    ~VideoOut() { close(); }
    VideoOut(const VideoOut&) = delete;
    VideoOut& operator=(const VideoOut&) = delete;

    void open();  // opens the device and sends one dark frame
    void close();
    [[nodiscard]] bool is_open() const { return fd_ >= 0; }
    // Sends one frame, or its first `bytes` only. No effect while closed.
    void send(const FrameView& frame, std::size_t bytes = SIZE_MAX);

  private:
    std::string device_;
    int width_, height_;
    int fd_ = -1;
};

}  // namespace hord::rig
