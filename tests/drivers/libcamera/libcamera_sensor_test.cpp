// The libcamera sensor: choice of camera and format, errors, and the frame queue. tests/system/contract tests the
// sensor's contract.
#include "drivers/libcamera/libcamera_sensor.h"

#include <array>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "drivers/libcamera/camera_process.h"
#include "drivers/libcamera/libcamera_options.h"
#include "tests/drivers/libcamera/fake_camera.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;
using Names = std::vector<std::string>;

TEST(CameraFormat, is_grey_of_the_bits_asked_for_and_unpacked_where_there_is_a_choice) {
    const Names there{"BGR888", "R10_CSI2P", "R10", "R8", "R12_CSI2P"};
    EXPECT_EQ(choose_grey_format("cam", there, 8)->name, "R8");
    const auto ten = choose_grey_format("cam", there, 10);
    EXPECT_EQ(ten->name, "R10");
    EXPECT_FALSE(ten->packed);
    const auto twelve = choose_grey_format("cam", there, 12);
    EXPECT_EQ(twelve->name, "R12_CSI2P");
    EXPECT_TRUE(twelve->packed);
}

TEST(CameraFormat, that_is_not_there_is_refused_with_the_list_of_what_there_is) {
    const auto colour = choose_grey_format("imx000", Names{"BGR888", "SRGGB10"}, 10);
    ASSERT_FALSE(colour);
    EXPECT_EQ(colour.error().code, ErrorCode::unsupported);
    EXPECT_THAT(colour.error().message(),
                AllOf(HasSubstr("imx000"), HasSubstr("R10 or R10_CSI2P"), HasSubstr("BGR888, SRGGB10"),
                      HasSubstr("sensor.bits")));
    EXPECT_THAT(choose_grey_format("cam", Names{}, 8).error().what, HasSubstr("it has none"));
    EXPECT_THAT(choose_grey_format("cam", Names{"R8"}, 9).error().cure, HasSubstr("8, 10, 12 or 16"));
}

TEST(CameraChoice, names_what_was_asked_for_and_lists_the_cameras) {
    EXPECT_EQ(*choose_camera(Names{"one"}, ""), "one");
    EXPECT_EQ(*choose_camera(Names{"one", "two"}, "two"), "two");
    const auto absent = choose_camera(Names{"one", "two"}, "three");
    EXPECT_EQ(absent.error().code, ErrorCode::not_found);
    EXPECT_THAT(absent.error().what, AllOf(HasSubstr("\"three\""), HasSubstr("one, two")));
    EXPECT_EQ(choose_camera(Names{"one", "two"}, "").error().code, ErrorCode::invalid_argument);
    EXPECT_EQ(choose_camera(Names{}, "").error().code, ErrorCode::not_found);
}

TEST(CameraFormat, of_colour_is_taken_only_where_green_was_asked_for_and_there_is_no_grey) {
    const Names colour{"XRGB8888", "RGB888", "BGR888"};
    EXPECT_FALSE(choose_grey_format("cam", colour, 8));
    const auto green = choose_grey_format("cam", colour, 8, true);
    ASSERT_TRUE(green);
    EXPECT_EQ(green->name, "BGR888");
    EXPECT_TRUE(green->green);
    EXPECT_FALSE(choose_grey_format("cam", colour, 10, true));
    EXPECT_FALSE(choose_grey_format("cam", Names{"BGR888", "R8"}, 8, true)->green);
    EXPECT_THAT(choose_grey_format("cam", Names{"XRGB8888"}, 8, true).error().what,
                HasSubstr("R8 or BGR888 or RGB888"));
}

// With the real libcamera; no machine has a camera of this name.
TEST(Libcamera, that_lacks_the_camera_says_so) {
    auto loop = std::move(*firmware::SdEventLoop::open());
    const auto absent = LibcameraSensor::open(*loop, {.camera = "no-such-camera"});
    ASSERT_FALSE(absent);
    EXPECT_EQ(absent.error().code, ErrorCode::not_found);
    EXPECT_THAT(absent.error().what, AllOf(HasSubstr("\"no-such-camera\""), HasSubstr("cameras: ")));
    EXPECT_FALSE(libcamera_version().empty());
}

struct Ear final : hal::Sensor::Listener {
    void on_frame(hal::FrameLease frame) override { frames.push_back(std::move(frame)); }
    void on_sensor_lost(const Error& error) override { losses.push_back(error); }
    std::vector<hal::FrameLease> frames;
    std::vector<Error> losses;
};

class Sensor : public testing::Test {
  protected:
    void open() {
        auto opened = LibcameraSensor::open(
            *loop_, {}, std::make_unique<FakeCameraPort>(camera_, LibcameraSensorOptions{}.buffers));
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
    std::unique_ptr<LibcameraSensor> sensor_;
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
    EXPECT_GE(loop_->now(), asked + LibcameraSensor::kSilence);
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
    camera_->green = true;
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
    camera_->packed = true;  // 12 samples in 15 of a row's 16 bytes
    open();
    const hal::FrameLease one = frame();
    EXPECT_EQ(one.view().bits, 10);
    EXPECT_EQ(one.info().bytes_used, 12U * 6 * 2);
    // Every byte is the frame's number b: four samples b << 2, and their low bits from the fifth byte.
    const std::uint32_t b = one.view().sample(0, 0) >> 2U;
    for (unsigned x = 0; x < 4; ++x)
        EXPECT_EQ(one.view().sample(static_cast<int>(x), 5), (b << 2U) | (b >> (2 * x) & 3U));
}

TEST_F(Sensor, whose_buffers_are_too_small_does_not_start) {
    auto opened = LibcameraSensor::open(*loop_, {.buffers = 8}, std::make_unique<FakeCameraPort>(camera_, 4));
    ASSERT_TRUE(opened);
    const auto started = (*opened)->start(ear_);
    ASSERT_FALSE(started);
    EXPECT_THAT(started.error().what, HasSubstr("only 4 buffers"));
    EXPECT_EQ(camera_->streams, 0);
    EXPECT_EQ(LibcameraSensor::open(*loop_, {.buffers = 33}, nullptr).error().code, ErrorCode::invalid_argument);
}

}  // namespace
}  // namespace hord::drivers
