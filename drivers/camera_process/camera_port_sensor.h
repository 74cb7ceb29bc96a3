// A lenslet sensor behind a CameraPort (camera_sensor.h).
//
// A camera is lost if it delivered no frame for kSilence after a triggered exposure: not every process is notified when
// it goes away.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "drivers/camera_process/camera_port.h"
#include "drivers/hal/camera_sensor.h"

namespace hord::drivers {

struct CameraPortOptions {
    std::string name = "the camera";  // for messages
    int buffers = 4;                  // one less can be lent at the same time
    CameraTriggers triggers = CameraTriggers::unknown;
    bool strobe_commands = false;  // CameraTriggers::command: a CameraStrobe commands; else trigger() does
    std::string cure_of_silence = "check what triggers it, and its cable";  // where triggers bring no frame
};

class CameraPortSensor final : public CameraSensor {
  public:
    static constexpr hal::Duration kSilence = std::chrono::seconds(2);

    // Of a light that the camera drives (camera_strobe.h).
    class ExposureListener {
      public:
        virtual void on_exposure(const CameraFrame& frame) = 0;  // of each frame, before the sensor's listener gets it
        virtual void on_camera_lost(const Error& error) = 0;

      protected:
        ~ExposureListener() = default;
    };

    // Of a light barrier on the camera's input (camera_part_sensor.h).
    class EdgeListener {
      public:
        virtual void on_camera_streams() = 0;  // the sequence of its edges begins at 1
        virtual void on_camera_edge(const CameraEdge& edge) = 0;
        virtual void on_camera_lost(const Error& error) = 0;

      protected:
        ~EdgeListener() = default;
    };

    // Loop thread; blocks while the camera is configured. Fails with not_found (lists the cameras), busy, unsupported
    // (lists the formats), io, invalid_argument (buffers not in 2..32).
    static Result<std::unique_ptr<CameraPortSensor>> open(hal::EventLoop& loop, const CameraPortOptions& options,
                                                          std::unique_ptr<CameraPort> port);
    ~CameraPortSensor() override;

    // Loop thread, all four. expose() sends the software trigger of `exposure`.
    void tell_exposures(ExposureListener* listener) { exposures_ = listener; }
    void tell_edges(EdgeListener* listener) { edges_ = listener; }
    [[nodiscard]] bool streams() const { return stream_ != nullptr && is_running(); }
    Result<void> expose(std::uint32_t exposure);

  private:
    struct Stream;
    CameraPortSensor(hal::EventLoop& loop, const CameraPortOptions& options, std::unique_ptr<CameraPort> port,
                     const CameraFormat& format);
    Result<void> do_start(Listener& listener) override;
    Result<void> do_trigger(const hal::ExposureRequest& request) override;
    void do_stop() override;
    void on_lost(const Error& error) override;
    void on_ready() override;  // frames from the camera's thread
    void expect_frame_after(hal::TimePoint time);
    void watch_for_silence();

    const std::unique_ptr<CameraPort> port_;
    const bool commands_;  // trigger() does
    ExposureListener* exposures_ = nullptr;
    EdgeListener* edges_ = nullptr;
    std::shared_ptr<Stream> stream_;  // null when stopped
    hal::EventLoop::TimerId silence_timer_{};
    std::optional<hal::TimePoint> silent_since_;  // a frame is awaited; the first one since the last frame came
};

}  // namespace hord::drivers
