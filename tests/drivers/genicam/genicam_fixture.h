// The sensor of a GenICam camera on a fake GigE camera, over the real protocol: two processes and a network between
// them. tests/system/contract tests the sensor's contract.
#pragma once

#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "drivers/genicam/genicam_sensor.h"
#include "tests/drivers/genicam/fake_gige.h"

namespace hord::drivers {

using namespace std::chrono_literals;

struct Ear final : hal::Sensor::Listener {
    // A camera obeys a command twice whose answer came late on a busy machine: the second frame is nobody's.
    void on_frame(hal::FrameLease frame) override {
        if (!commands || frame.info().exposure != 0) frames.push_back(std::move(frame));
    }
    void on_sensor_lost(const Error& error) override { losses.push_back(error); }
    std::vector<hal::FrameLease> frames;
    std::vector<Error> losses;
    bool commands = false;
};

class Genicam : public testing::Test {
  protected:
    void SetUp() override {
        const std::string refused = test::own_network();
        if (!refused.empty()) GTEST_SKIP() << refused;
        loop_ = std::move(*firmware::SdEventLoop::open());
    }
    void TearDown() override {
        ear_.frames.clear();
        if (sensor_) sensor_->stop();
    }
    static GenicamSensorOptions software(int width_px = 64, int height_px = 48) {
        return {.width_px = width_px, .height_px = height_px, .trigger = CameraTrigger::software};
    }
    Result<void> open(const GenicamSensorOptions& options) {
        sensor_.reset();
        auto opened = open_genicam_sensor(*loop_, options, camera_program("hord-genicam"));
        if (!opened) return tl::unexpected(opened.error());
        sensor_ = std::move(*opened);
        return {};
    }
    Error refusal(const GenicamSensorOptions& options) {
        const auto opened = open(options);
        EXPECT_FALSE(opened);
        return opened ? Error{} : opened.error();
    }
    // Throws if it does not start: an assertion here would end this function alone, and the test would go on without a
    // sensor.
    void start(const GenicamSensorOptions& options) {
        if (const auto opened = open(options); !opened) throw std::runtime_error(opened.error().message());
        ear_.commands = options.trigger == CameraTrigger::software;
        if (const auto started = sensor_->start(ear_); !started) throw std::runtime_error(started.error().message());
    }
    bool run_until(const std::function<bool()>& done, hal::Duration within = 30s) {
        return loop_->run_until(done, within);
    }
    // The next frame; an empty lease: none came.
    hal::FrameLease frame(hal::Duration within = 30s) {
        asked_ = loop_->now() + 1ms;
        EXPECT_TRUE(sensor_->trigger({.exposure = 1, .start = asked_, .length = 1ms}));
        if (!run_until([&] { return !ear_.frames.empty(); }, within)) return {};
        hal::FrameLease one = std::move(ear_.frames.back());
        ear_.frames.clear();
        return one;
    }

    std::unique_ptr<firmware::SdEventLoop> loop_;
    std::unique_ptr<CameraPortSensor> sensor_;
    Ear ear_;
    hal::TimePoint asked_;
};

// Whether every sample is that of one frame of the fake camera's.
inline bool is_one_frame(const FrameView& view) {
    const std::uint32_t first = view.sample(0, 0);
    for (int y = 0; y < view.height_px; ++y) {
        for (int x = 0; x < view.width_px; ++x) {
            if (view.sample(x, y) != ((first + static_cast<std::uint32_t>(x + 3 * y)) & view.full_scale()))
                return false;
        }
    }
    return true;
}

}  // namespace hord::drivers
