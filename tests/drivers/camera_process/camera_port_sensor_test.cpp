// The sensor behind a CameraPort: the frame queue, silence, software triggers, lost frames. tests/system/contract tests
// the sensor's contract.
#include "drivers/camera_process/camera_port_sensor.h"

#include <array>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "tests/drivers/camera_process/fake_camera.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

struct Ear final : hal::Sensor::Listener {
    void on_frame(hal::FrameLease frame) override { frames.push_back(std::move(frame)); }
    void on_sensor_lost(const Error& error) override { losses.push_back(error); }
    std::vector<hal::FrameLease> frames;
    std::vector<Error> losses;
};

class Sensor : public testing::Test {
  protected:
    void open() {
        auto opened =
            CameraPortSensor::open(*loop_, options_, std::make_unique<FakeCameraPort>(camera_, options_.buffers));
        ASSERT_TRUE(opened) << opened.error().message();
        sensor_ = std::move(*opened);
        ASSERT_TRUE(sensor_->start(ear_));
    }
    ~Sensor() override {
        ear_.frames.clear();
        if (sensor_) sensor_->stop();
    }
    bool run_until(const std::function<bool()>& done) { return loop_->run_until(done, 60s); }
    hal::FrameLease frame() {
        EXPECT_TRUE(sensor_->trigger({.exposure = 1, .start = loop_->now() + 1ms, .length = 1ms}));
        EXPECT_TRUE(run_until([&] { return !ear_.frames.empty(); }));
        hal::FrameLease one = std::move(ear_.frames.back());
        ear_.frames.clear();
        return one;
    }

    std::unique_ptr<firmware::SdEventLoop> loop_ = std::move(*firmware::SdEventLoop::open());
    std::shared_ptr<FakeCamera> camera_ = std::make_shared<FakeCamera>(*loop_);
    CameraPortOptions options_;
    std::unique_ptr<CameraPortSensor> sensor_;
    Ear ear_;
};

TEST_F(Sensor, frames_that_nobody_asked_for_go_straight_back_and_are_no_gap) {
    open();
    ASSERT_TRUE(run_until([&] {
        const std::scoped_lock lock(camera_->mutex);
        return camera_->queue_calls >= 10;
    }));
    const std::uint32_t first = frame().info().sequence;
    ASSERT_TRUE(run_until([&, from = loop_->now()] { return loop_->now() - from > 20ms; }));
    EXPECT_EQ(frame().info().sequence, first + 1);
    EXPECT_TRUE(ear_.frames.empty());
}

// Unplugged while it holds its buffers, without a notification. Without an open trigger, silence is no loss: the camera
// may be triggered by wire.
TEST_F(Sensor, that_was_asked_for_a_frame_and_falls_silent_is_lost) {
    open();
    (void)frame();
    camera_->change([](FakeCamera& camera) { camera.silent = true; });
    const hal::TimePoint asked = loop_->now() + 1ms;
    ASSERT_TRUE(sensor_->trigger({.exposure = 2, .start = asked, .length = 1ms}));
    ASSERT_TRUE(run_until([&] { return !ear_.losses.empty(); }));
    EXPECT_GE(loop_->now(), asked + CameraPortSensor::kSilence);
    EXPECT_THAT(ear_.losses[0].what, HasSubstr("no frames"));
    EXPECT_EQ(sensor_->trigger({.exposure = 3, .start = loop_->now(), .length = 1ms}).error().code,
              ErrorCode::disconnected);
    sensor_->stop();
    camera_->change([](FakeCamera& camera) { camera.silent = false; });
    ASSERT_TRUE(sensor_->start(ear_));
    EXPECT_TRUE(frame());
    EXPECT_EQ(ear_.losses.size(), 1U);
}

TEST_F(Sensor, a_lent_buffer_is_not_with_the_camera_and_goes_back_when_its_lease_dies) {
    open();
    hal::FrameLease lent = frame();
    const auto value = lent.view().sample(0, 0);
    ASSERT_TRUE(run_until([&, from = loop_->now()] {
        return loop_->now() - from > 30ms;
    }));  // the camera continues with the other buffers
    EXPECT_EQ(lent.view().sample(0, 0), value);
    const auto calls = [&] {
        const std::scoped_lock lock(camera_->mutex);
        return camera_->queue_calls;
    };
    std::thread([&] { lent.give_back(); }).join();
    const int before = calls();
    EXPECT_TRUE(run_until([&] { return calls() > before; }));
}

TEST_F(Sensor, whose_time_stamps_are_of_the_exposures_end_is_matched_all_the_same) {
    camera_->tells_start = false;
    open();
    const hal::TimePoint asked = loop_->now() + 1ms;
    const hal::FrameLease one = frame();
    EXPECT_GE(one.info().exposure_start, asked);
    EXPECT_LE(one.info().exposure_start, loop_->now());
}

TEST_F(Sensor, short_and_corrupt_frames_are_told_as_such) {
    camera_->short_by = 5;
    camera_->corrupt = true;
    open();
    const hal::FrameLease one = frame();
    EXPECT_EQ(one.info().bytes_used, 16U * 6 - 5);
    EXPECT_TRUE(one.info().corrupt);
}

TEST_F(Sensor, the_green_samples_of_a_colour_frame_are_taken_row_by_row) {
    camera_->pixel_format = "BGR888";
    camera_->layout = SampleLayout::green;
    camera_->width_px = 5;  // in 15 of a row's 16 bytes
    camera_->colours = {0x11, 0, 0x33};
    open();
    const hal::FrameLease one = frame();
    EXPECT_EQ(one.view().bits, 8);
    EXPECT_EQ(one.view().stride_bytes, 5);
    EXPECT_EQ(one.info().bytes_used, 5U * 6);
    for (int y = 0; y < 6; ++y) {
        for (int x = 0; x < 5; ++x) EXPECT_EQ(one.view().sample(x, y), y * 16 + x) << x << ", " << y;
    }
    camera_->change([](FakeCamera& camera) { camera.short_by = 18; });  // the last row, and a byte of the one before
    (void)frame();
    EXPECT_EQ(frame().info().bytes_used, 5U * 4);
}

TEST_F(Sensor, packed_samples_are_unpacked_row_by_row) {
    camera_->pixel_format = "R10_CSI2P";
    camera_->bits = 10;
    camera_->layout = SampleLayout::mipi;  // 12 samples in 15 of a row's 16 bytes
    open();
    const hal::FrameLease one = frame();
    EXPECT_EQ(one.view().bits, 10);
    EXPECT_EQ(one.info().bytes_used, 12U * 6 * 2);
    // Every byte is the frame's number b: four samples b << 2, and their low bits from the fifth byte.
    const std::uint32_t b = one.view().sample(0, 0) >> 2U;
    for (unsigned x = 0; x < 4; ++x)
        EXPECT_EQ(one.view().sample(static_cast<int>(x), 5), (b << 2U) | (b >> (2 * x) & 3U));
}

TEST_F(Sensor, frames_in_a_packing_of_industrial_cameras_are_unpacked_as_a_whole) {
    for (const auto layout : {SampleLayout::gige, SampleLayout::pfnc}) {
        camera_->change([&](FakeCamera& camera) {
            camera.layout = layout;
            camera.bits = 12;
            camera.width_px = 5;  // rows begin inside a group
            camera.short_by = 0;
        });
        open();
        const hal::FrameLease one = frame();
        EXPECT_EQ(one.view().stride_bytes, 10);
        EXPECT_EQ(one.info().bytes_used, 5U * 6 * 2);
        const unsigned first = one.view().sample(0, 0);  // every byte is the frame's number
        const unsigned number = layout == SampleLayout::gige ? first >> 4U : first & 0xFFU;
        EXPECT_GT(number, 0U);
        EXPECT_EQ(first,
                  layout == SampleLayout::gige ? (number << 4U) | (number & 15U) : number | (number & 15U) << 8U);
        camera_->change([](FakeCamera& camera) { camera.short_by = 16 * 6 - 44; });  // 45 bytes are a frame
        (void)frame();
        EXPECT_EQ(frame().info().bytes_used, 0U);
        sensor_->stop();
    }
}

// One exposure after the other; each is triggered when it is due, none before.
TEST_F(Sensor, with_a_software_trigger_makes_one_frame_for_each_exposure) {
    camera_->triggers = 0;
    options_.triggers = CameraTriggers::command;
    open();
    for (int k = 0; k < 5; ++k) {
        const hal::TimePoint due = loop_->now() + 5ms;
        ASSERT_TRUE(sensor_->trigger({.exposure = 1, .start = due, .length = 1ms}));
        ASSERT_TRUE(run_until([&] { return !ear_.frames.empty(); }));
        EXPECT_GE(ear_.frames[0].info().exposure_start, due);
        EXPECT_EQ(ear_.frames[0].info().sequence, static_cast<std::uint32_t>(k + 1));
        ear_.frames.clear();
    }
}

// The camera may still obey a trigger whose frame has not come: the next one waits for kPatience.
TEST_F(Sensor, after_a_lost_frame_the_next_trigger_goes_out_when_the_patience_is_over) {
    camera_->triggers = 0;
    options_.triggers = CameraTriggers::command;
    open();
    camera_->change([](FakeCamera& camera) { camera.lose = 1; });
    const hal::TimePoint lost = loop_->now() + 1ms, after = lost + CameraSensor::kPatience + 100ms;
    ASSERT_TRUE(sensor_->trigger({.exposure = 1, .start = lost, .length = 1ms}));
    ASSERT_TRUE(sensor_->trigger({.exposure = 2, .start = lost + 30ms, .length = 1ms}));
    ASSERT_TRUE(sensor_->trigger({.exposure = 3, .start = after, .length = 1ms}));
    ASSERT_TRUE(run_until([&] { return !ear_.frames.empty(); }));
    EXPECT_EQ(ear_.frames[0].info().exposure, 3U);
    EXPECT_GE(ear_.frames[0].info().exposure_start, after);
    EXPECT_EQ(ear_.frames[0].info().sequence, 2U) << "the camera was triggered twice";
}

TEST_F(Sensor, whose_buffers_are_too_small_does_not_start) {
    auto opened = CameraPortSensor::open(*loop_, {.buffers = 8}, std::make_unique<FakeCameraPort>(camera_, 4));
    ASSERT_TRUE(opened);
    const auto started = (*opened)->start(ear_);
    ASSERT_FALSE(started);
    EXPECT_THAT(started.error().what, HasSubstr("only 4 buffers"));
    EXPECT_EQ(camera_->streams, 0);
    EXPECT_EQ(CameraPortSensor::open(*loop_, {.buffers = 33}, nullptr).error().code, ErrorCode::invalid_argument);
}

}  // namespace
}  // namespace hord::drivers
