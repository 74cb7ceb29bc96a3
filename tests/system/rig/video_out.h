// The writing end of a v4l2loopback device: what the sensor behind it sends.
#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "common/frame.h"

namespace hord::rig {

class VideoOut {
  public:
    // GREY. Throws std::runtime_error when the device is not there or takes no such frames.
    VideoOut(std::string device, int width_px, int height_px);
    ~VideoOut() { close(); }
    VideoOut(const VideoOut&) = delete;
    VideoOut& operator=(const VideoOut&) = delete;

    void open();  // and sends one dark frame
    void close();
    [[nodiscard]] bool is_open() const { return fd_ >= 0; }
    // One frame, or the first `bytes` of it; nothing while closed.
    void send(const FrameView& frame, std::size_t bytes = SIZE_MAX);

  private:
    std::string device_;
    int width_, height_;
    int fd_ = -1;
};

}  // namespace hord::rig
