// Frames and triggers, lent and queued buffers, of a camera made by the test.
#include "drivers/hal/camera_sensor.h"

#include <algorithm>
#include <optional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "lab/virtual_time/virtual_time.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int kWidth = 4, kHeight = 2;

struct TestStream final : CameraStream {
    std::vector<std::vector<std::byte>> bytes;
    std::vector<std::uint32_t> queued;
    bool works = true;
    TestStream(std::size_t buffers, std::size_t size) : bytes(buffers, std::vector<std::byte>(size)) {
        for (const auto& buffer : bytes) memory.emplace_back(buffer);
    }
    Result<void> queue(std::uint32_t buffer) override {
        if (!works) return fail(ErrorCode::io, "the kernel refuses", "");
        queued.push_back(buffer);
        return {};
    }
};

class TestCamera final : public CameraSensor {
  public:
    using CameraSensor::begin_command, CameraSensor::check_buffers, CameraSensor::deliver, CameraSensor::lose,
        CameraSensor::is_running;
    explicit TestCamera(hal::EventLoop& loop, CameraTriggers triggers = CameraTriggers::unknown)
        : CameraSensor(loop, "the camera", triggers, "look at its wire") {
        format_ = {kWidth, kHeight, 8, 2};
        stride_bytes_ = kWidth;
    }
    void packed(SampleLayout layout, int bits, std::ptrdiff_t stride) {
        layout_ = layout;
        format_.bits = bits;
        stride_bytes_ = stride;
    }
    std::shared_ptr<TestStream> stream = std::make_shared<TestStream>(3, std::size_t{kWidth} * kHeight);
    int losses = 0, descriptor = -1;

  private:
    Result<void> do_start(Listener& listener) override { return begin(stream, descriptor, listener); }
    void do_stop() override { (void)end(); }
    void on_ready() override {}
    void on_lost(const Error&) override { ++losses; }
};

class Camera : public ::testing::Test, public hal::SensorListener {
  protected:
    lab::VirtualTime loop;
    TestCamera camera{loop};
    std::vector<hal::FrameLease> frames;
    std::vector<Error> lost;

    void on_frame(hal::FrameLease frame) override { frames.push_back(std::move(frame)); }
    void on_sensor_lost(const Error& error) override { lost.push_back(error); }

    static hal::TimePoint at(hal::Duration t) { return hal::TimePoint(10s + t); }
    void start() { ASSERT_TRUE(camera.start(*this)); }
    Result<void> trigger(hal::Duration start) { return camera.trigger({1, at(start), 1ms}); }
    void frame(hal::Duration stamp, std::uint32_t buffer = 0, std::uint32_t sequence = 0, std::size_t bytes = 8) {
        camera.deliver({buffer, sequence, at(stamp), true, bytes, false});
    }
    std::vector<std::uint32_t>& queued() { return camera.stream->queued; }
};

TEST_F(Camera, a_frame_answers_the_trigger_whose_exposure_it_is) {
    start();
    ASSERT_TRUE(trigger(0ms));
    frame(0ms, 2, 40);
    ASSERT_EQ(frames.size(), 1U);
    EXPECT_EQ(frames[0].info().sequence, 40U);
    EXPECT_EQ(frames[0].info().exposure_start, at(0ms));
    EXPECT_EQ(frames[0].info().bytes_used, 8U);
    EXPECT_EQ(frames[0].view().data, camera.stream->bytes[2].data());
    EXPECT_EQ(frames[0].view().stride_bytes, kWidth);
    EXPECT_THAT(queued(), IsEmpty());
    frames.clear();
    EXPECT_THAT(queued(), ElementsAre(2));
}

TEST_F(Camera, stamps_of_an_exposures_end_are_moved_to_its_start) {
    start();
    ASSERT_TRUE(trigger(0ms));
    camera.deliver({0, 0, at(1ms) - hal::Duration(1), false, 8, true});
    EXPECT_THAT(frames, IsEmpty()) << "it began before the trigger";
    camera.deliver({0, 1, at(1ms), false, 8, true});
    ASSERT_EQ(frames.size(), 1U);
    EXPECT_EQ(frames[0].info().exposure_start, at(0ms));
    EXPECT_TRUE(frames[0].info().corrupt);
}

TEST_F(Camera, frames_without_a_trigger_go_back_and_leave_no_gap) {
    start();
    frame(0ms, 0, 5);
    frame(10ms, 1, 6);
    EXPECT_THAT(queued(), ElementsAre(0, 1));
    ASSERT_TRUE(trigger(20ms));
    frame(20ms - 1ns, 2, 7);
    EXPECT_THAT(frames, IsEmpty());
    frame(20ms, 0, 8);
    ASSERT_EQ(frames.size(), 1U);
    EXPECT_EQ(frames[0].info().sequence, 5U);
    ASSERT_TRUE(trigger(30ms));
    frame(30ms, 1, 10);
    EXPECT_EQ(frames[1].info().sequence, 7U) << "a frame that the camera lost is a gap";
}

TEST_F(Camera, a_trigger_whose_frame_never_came_is_forgotten_when_the_next_one_is_exposed) {
    start();
    ASSERT_TRUE(trigger(0ms));
    ASSERT_TRUE(trigger(10ms));
    frame(10ms);
    ASSERT_EQ(frames.size(), 1U);
    EXPECT_EQ(frames[0].info().exposure_start, at(10ms));
    frame(11ms, 1);
    EXPECT_EQ(frames.size(), 1U) << "no trigger is open";
}

TEST_F(Camera, each_of_two_open_triggers_keeps_its_own_frame) {
    start();
    ASSERT_TRUE(trigger(0ms));
    ASSERT_TRUE(trigger(10ms));
    frame(1ms, 0);
    ASSERT_EQ(frames.size(), 1U);
    frame(10ms, 1);
    ASSERT_EQ(frames.size(), 2U);
    EXPECT_EQ(frames[1].info().exposure_start, at(10ms));
}

TEST_F(Camera, the_end_of_an_exposure_belongs_to_the_trigger_that_had_begun_by_the_length_before_it) {
    start();
    ASSERT_TRUE(trigger(0ms));
    ASSERT_TRUE(camera.trigger({2, at(10ms), 5ms}));
    camera.deliver({0, 0, at(12ms), false, 8, false});  // 5 ms before it, the second one had not begun
    ASSERT_EQ(frames.size(), 1U);
    EXPECT_EQ(frames[0].info().exposure_start, at(11ms));
    camera.deliver({1, 1, at(15ms), false, 8, false});
    ASSERT_EQ(frames.size(), 2U);
    EXPECT_EQ(frames[1].info().exposure_start, at(10ms));
}

// A camera that makes a frame for each trigger and for nothing else.
class TriggeredCamera : public ::testing::Test, public hal::SensorListener {
  protected:
    lab::VirtualTime loop;
    std::optional<TestCamera> camera;
    std::vector<hal::FrameInfo> frames;
    std::vector<Error> lost;  // those that a test does not take out fail it
    std::uint32_t sequence = 0;

    void on_frame(hal::FrameLease frame) override { frames.push_back(frame.info()); }
    void on_sensor_lost(const Error& error) override { lost.push_back(error); }
    void TearDown() override {
        for (const Error& error : lost) ADD_FAILURE() << error.message();
    }

    void start(CameraTriggers triggers) {
        camera.emplace(loop, triggers);
        ASSERT_TRUE(camera->start(*this));
    }
    Result<void> trigger(std::uint32_t exposure) { return camera->trigger({exposure, loop.now(), 1ms}); }
    void frame(bool stamp_error_known = true) {
        camera->deliver({0, ++sequence, loop.now(), true, 8, false, stamp_error_known});
    }
    void command(std::uint32_t exposure) {
        ASSERT_TRUE(trigger(exposure));
        ASSERT_TRUE(camera->begin_command(exposure));
    }
    // A frame that comes now from a camera whose clock cannot be read. Returns whose it is; 0: nobody's.
    std::uint32_t whose() {
        frame(false);
        EXPECT_EQ(frames.back().nobodys, frames.back().exposure == 0);
        return frames.back().exposure;
    }
};

TEST_F(TriggeredCamera, a_late_frame_uses_up_its_command_and_is_not_the_next_ones) {
    start(CameraTriggers::command);
    const hal::TimePoint asked = loop.now();
    ASSERT_TRUE(trigger(15));
    ASSERT_TRUE(camera->begin_command(15));
    loop.run_for(50ms);
    ASSERT_TRUE(trigger(16)) << "what was asked for is not commanded yet";
    EXPECT_EQ(camera->begin_command(16).error().code, ErrorCode::busy);
    loop.run_for(2ms);
    frame();
    ASSERT_EQ(frames.size(), 1U);
    EXPECT_EQ(frames[0].exposure, 15U);
    EXPECT_EQ(frames[0].exposure_start, asked + 52ms);
    loop.run_for(50ms);
    ASSERT_TRUE(trigger(17));
    ASSERT_TRUE(camera->begin_command(17));
    loop.run_for(1ms);
    frame();
    ASSERT_EQ(frames.size(), 2U);
    EXPECT_EQ(frames[1].exposure, 17U);
}

TEST_F(TriggeredCamera, a_frame_that_never_comes_holds_commands_back_for_the_patience_alone) {
    start(CameraTriggers::command);
    for (std::uint32_t k = 1; k <= 8; ++k) {
        ASSERT_TRUE(trigger(2 * k - 1)) << k;
        ASSERT_TRUE(camera->begin_command(2 * k - 1)) << k;
        loop.run_for(250ms);
        ASSERT_TRUE(trigger(2 * k)) << k;
        EXPECT_FALSE(camera->begin_command(2 * k)) << k;
        loop.run_for(CameraSensor::kPatience - 250ms - hal::Duration(1));
        EXPECT_THAT(trigger(2 * k).error().message(), HasSubstr("has not come for 999 ms: look at its wire")) << k;
        loop.run_for(hal::Duration(1));
    }
    ASSERT_TRUE(trigger(99));
    ASSERT_TRUE(camera->begin_command(99));
    frame();
    ASSERT_EQ(frames.size(), 1U);
    EXPECT_EQ(frames[0].exposure, 99U);
}

// The exposures before a commanded one are not commanded any more; those after it are.
TEST_F(TriggeredCamera, a_command_forgets_the_exposures_before_its_own_and_gives_their_buffers_back) {
    for (const bool its_own_waits : {true, false}) {
        start(CameraTriggers::command);
        const hal::TimePoint later = loop.now() + 1s;
        ASSERT_TRUE(camera->trigger({1, later, 1ms}));
        ASSERT_TRUE(camera->trigger({2, later + 10ms, 1ms}));
        ASSERT_TRUE(camera->begin_command(its_own_waits ? 2 : 9));
        EXPECT_EQ(camera->trigger({3, later + 20ms, 1ms}).has_value(), its_own_waits);
    }
}

TEST_F(TriggeredCamera, a_frame_from_before_the_command_is_delivered_as_nobodys) {
    start(CameraTriggers::command);
    frame();
    loop.run_for(1ms);
    ASSERT_TRUE(trigger(1));
    ASSERT_TRUE(camera->begin_command(1));
    camera->deliver({0, ++sequence, loop.now() - hal::Duration(1), true, 8, false});
    frame();
    frame();
    ASSERT_EQ(frames.size(), 4U);
    for (const int nobodys : {0, 1, 3}) EXPECT_TRUE(frames[static_cast<std::size_t>(nobodys)].nobodys) << nobodys;
    EXPECT_EQ(frames[2].exposure, 1U);
    EXPECT_FALSE(frames[2].nobodys);
    EXPECT_THAT(camera->stream->queued, ElementsAre(0, 0, 0, 0));
}

// Its time stamp is that of its arrival, so it looks as if it were the open command's.
TEST_F(TriggeredCamera, whose_clock_is_unknown_gives_the_frame_of_a_command_that_was_given_up_to_nobody) {
    start(CameraTriggers::command);
    command(1);
    EXPECT_EQ(whose(), 1U);
    command(2);
    loop.run_for(1s);
    command(3);
    loop.run_for(400ms);
    EXPECT_EQ(whose(), 0U) << "the frame of command 2";
    EXPECT_EQ(whose(), 3U);
    command(4);
    ++sequence;  // the frame is lost on its way
    loop.run_for(1s);
    command(5);
    EXPECT_EQ(whose(), 5U);
    command(6);
    EXPECT_EQ(whose(), 6U);
}

TEST_F(TriggeredCamera, whose_frames_cannot_be_proven_any_more_is_lost_and_begins_anew_at_the_next_start) {
    for (const bool first : {true, false}) {
        start(CameraTriggers::command);
        if (!first) {
            command(1);
            EXPECT_EQ(whose(), 1U);
        }
        command(2);  // ignored, or always late: both look the same
        for (std::uint32_t k = 0; k < CameraSensor::kMaxUnproven; ++k) {
            loop.run_for(1s);
            ASSERT_THAT(lost, IsEmpty());
            command(3 + k);
            EXPECT_EQ(whose(), 0U) << k;
        }
        loop.run_for(1ms);
        ASSERT_EQ(lost.size(), 1U);
        EXPECT_THAT(lost[0].message(), HasSubstr("do not show which trigger made them"));
        lost.clear();
        camera->stop();
        ASSERT_TRUE(camera->start(*this));
        command(9);
        EXPECT_EQ(whose(), 9U);
    }
}

TEST_F(TriggeredCamera, a_second_frame_of_a_wires_pulse_is_delivered_as_nobodys) {
    start(CameraTriggers::wire);
    ASSERT_TRUE(trigger(1));
    frame();
    frame();
    ASSERT_EQ(frames.size(), 2U);
    EXPECT_FALSE(frames[1].nobodys) << "its time stamp says whose it is";
    EXPECT_EQ(frames[1].sequence, frames[0].sequence + 1);
}

TEST_F(TriggeredCamera, that_sends_nothing_or_frames_from_before_is_said_not_to_lack_buffers) {
    start(CameraTriggers::wire);
    for (const bool frames_come : {false, true}) {
        const hal::TimePoint stands_still = loop.now() - 1ms;
        loop.run_for(1s);
        for (std::uint32_t k = 0; k < 2; ++k) {
            ASSERT_TRUE(trigger(k + 1));
            loop.run_for(200ms);
            if (frames_come) camera->deliver({0, ++sequence, stands_still, true, 8, false});
        }
        const Error error = trigger(3).error();
        EXPECT_EQ(error.code, ErrorCode::busy);
        EXPECT_THAT(error.message(),
                    HasSubstr(frames_come ? "frames whose time stamps are before their triggers" : "brought no frame"));
        EXPECT_THAT(error.cure, HasSubstr(frames_come ? "clock" : "look at its wire"));
        camera->stop();
        ASSERT_TRUE(camera->start(*this));
    }
}

TEST_F(Camera, buffers_that_are_lent_or_filling_are_counted) {
    start();
    ASSERT_TRUE(trigger(0ms));
    frame(0ms);
    ASSERT_TRUE(trigger(10ms));
    const auto third = trigger(20ms);
    ASSERT_FALSE(third);
    EXPECT_EQ(third.error().code, ErrorCode::busy);
    frames.clear();
    EXPECT_TRUE(trigger(20ms));
}

TEST_F(Camera, a_lease_of_an_earlier_start_is_not_queued_and_takes_no_room) {
    start();
    ASSERT_TRUE(trigger(0ms));
    frame(0ms, 1);
    camera.stop();
    const auto first = std::exchange(camera.stream, std::make_shared<TestStream>(3, 8));
    start();
    ASSERT_TRUE(trigger(0ms));
    frame(0ms, 1);
    ASSERT_TRUE(trigger(10ms));
    frames.erase(frames.begin());  // buffer 1 of the first stream
    EXPECT_THAT(first->queued, IsEmpty());
    EXPECT_THAT(queued(), IsEmpty());
    EXPECT_EQ(trigger(20ms).error().code, ErrorCode::busy) << "the lease of this stream still counts";
    frames.clear();
    EXPECT_THAT(queued(), ElementsAre(1));
    camera.stop();
    start();
    EXPECT_TRUE(trigger(30ms) && trigger(40ms)) << "open triggers end with the stream";
}

TEST_F(Camera, a_loss_is_told_once_by_the_loop_and_refuses_triggers) {
    start();
    ASSERT_TRUE(trigger(0ms));
    camera.lose("its cable");
    camera.lose("again");
    EXPECT_EQ(camera.losses, 1);
    frame(0ms);
    EXPECT_THAT(frames, IsEmpty()) << "what comes after the loss answers no trigger";
    EXPECT_THAT(lost, IsEmpty());
    EXPECT_FALSE(camera.is_running());
    loop.run_for(0ms);
    ASSERT_EQ(lost.size(), 1U);
    EXPECT_EQ(lost[0].what, "its cable");
    EXPECT_EQ(lost[0].code, ErrorCode::disconnected);
    EXPECT_EQ(trigger(10ms).error().code, ErrorCode::disconnected);
    camera.stop();
    start();
    EXPECT_TRUE(camera.is_running());
    EXPECT_TRUE(trigger(20ms) && trigger(30ms));
}

TEST_F(Camera, a_loss_is_not_told_after_stop) {
    start();
    camera.lose("its cable");
    camera.stop();
    loop.run_for(1s);
    EXPECT_THAT(lost, IsEmpty());
}

TEST_F(Camera, what_the_camera_says_of_its_buffers_is_checked) {
    start();
    frame(0ms, 3);
    loop.run_for(0ms);
    ASSERT_EQ(lost.size(), 1U);
    EXPECT_THAT(lost[0].what, HasSubstr("does not exist"));
    camera.stop();
    start();
    camera.stream->works = false;
    frame(0ms, 2);
    loop.run_for(0ms);
    ASSERT_EQ(lost.size(), 2U);
    EXPECT_THAT(lost[1].what, HasSubstr("the kernel refuses"));
}

TEST_F(Camera, too_few_or_too_small_buffers_are_refused) {
    camera.stream = std::make_shared<TestStream>(2, 8);
    EXPECT_THAT(camera.start(*this).error().what, HasSubstr("only 2 buffers"));
    camera.stream = std::make_shared<TestStream>(3, 7);
    EXPECT_THAT(camera.start(*this).error().what, HasSubstr("smaller than a frame"));
    EXPECT_FALSE(camera.is_running());
    EXPECT_FALSE(TestCamera::check_buffers(1) || TestCamera::check_buffers(33));
    EXPECT_TRUE(TestCamera::check_buffers(2) && TestCamera::check_buffers(32));
}

// Rows of four samples of 10 bits in 5 bytes and one of padding.
TEST_F(Camera, packed_rows_of_a_sensor_are_taken_row_by_row) {
    camera.packed(SampleLayout::mipi, 10, 6);
    camera.stream = std::make_shared<TestStream>(3, 12);
    for (std::size_t k = 0; k < 12; ++k) camera.stream->bytes[0][k] = static_cast<std::byte>(k + 1);
    start();
    for (const auto& [given, whole] : {std::pair(12, 16), std::pair(11, 16), std::pair(10, 8), std::pair(4, 0)}) {
        ASSERT_TRUE(trigger(0ms));
        frame(0ms, 0, 0, static_cast<std::size_t>(given));
        ASSERT_EQ(frames.size(), 1U);
        EXPECT_EQ(frames[0].info().bytes_used, static_cast<std::size_t>(whole)) << given;
        EXPECT_EQ(frames[0].view().stride_bytes, 8);
        if (given == 12) {  // the lowest bits of the four are in the fifth byte
            const auto* const samples = reinterpret_cast<const std::uint16_t*>(frames[0].view().data);
            EXPECT_EQ(samples[0], (1U << 2U) + (5U & 3U));
            EXPECT_EQ(samples[1], (2U << 2U) + (5U >> 2U & 3U));
            EXPECT_EQ(samples[4], (7U << 2U) + (11U & 3U));
        }
        frames.clear();
    }
}

TEST_F(Camera, on_a_loop_that_cannot_watch_it_does_not_start) {
    camera.descriptor = 0;
    EXPECT_FALSE(camera.start(*this));
    EXPECT_FALSE(camera.is_running());
    camera.descriptor = -1;
    start();
}

TEST_F(Camera, the_green_of_complete_rows_is_taken) {
    camera.packed(SampleLayout::green, 8, 16);  // 12 bytes and padding
    camera.stream = std::make_shared<TestStream>(3, 32);
    for (std::size_t k = 0; k < 32; ++k) camera.stream->bytes[0][k] = static_cast<std::byte>(k);
    start();
    const std::pair<std::size_t, std::size_t> sizes[] = {{32, 8}, {28, 8}, {27, 4}, {12, 4}, {11, 0}, {0, 0}};
    for (const auto& [given, whole] : sizes) {
        ASSERT_TRUE(trigger(0ms));
        frame(0ms, 0, 0, given);
        ASSERT_EQ(frames.size(), 1U);
        EXPECT_EQ(frames[0].info().bytes_used, whole) << given;
        if (given == 32) {
            EXPECT_EQ(frames[0].view().stride_bytes, kWidth);
            std::vector<int> got;
            for (std::size_t k = 0; k < 8; ++k) got.push_back(std::to_integer<int>(frames[0].view().data[k]));
            EXPECT_THAT(got, ElementsAre(1, 4, 7, 10, 17, 20, 23, 26));
        }
        frames.clear();
    }
}

TEST_F(Camera, packed_samples_are_16_bits_wide_and_whole_or_none) {
    camera.packed(SampleLayout::gige, 12, 6);  // two rows of four samples in 12 bytes
    camera.stream = std::make_shared<TestStream>(3, 12);
    for (std::size_t k = 0; k < 12; ++k) camera.stream->bytes[0][k] = static_cast<std::byte>(k + 1);
    start();
    ASSERT_TRUE(trigger(0ms));
    frame(0ms, 0, 0, 100);  // more than the buffer has
    ASSERT_EQ(frames.size(), 1U);
    EXPECT_EQ(frames[0].info().bytes_used, 16U);
    EXPECT_EQ(frames[0].view().stride_bytes, 8);
    EXPECT_EQ(reinterpret_cast<const std::uint16_t*>(frames[0].view().data)[0], 0x12);
    frames.clear();
    ASSERT_TRUE(trigger(0ms));
    frame(0ms, 0, 0, 11);
    EXPECT_EQ(frames.at(0).info().bytes_used, 0U);
}

}  // namespace
}  // namespace hord::drivers
