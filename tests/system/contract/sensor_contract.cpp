// The contract of drivers/hal/sensor.h, tested on every backend.
#include <thread>

#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

using namespace std::chrono_literals;
using hal::ExposureRequest;
using hal::FrameLease;
using hal::TimePoint;

struct Ear final : hal::Sensor::Listener {
    void on_frame(FrameLease frame) override {
        frames.push_back(std::move(frame));
        if (then) then();
    }
    void on_sensor_lost(const Error& error) override { losses.push_back(error); }
    std::vector<FrameLease> frames;
    std::vector<Error> losses;
    std::function<void()> then;
};

ExposureRequest exposure(SensorHarness& h, std::uint32_t number) {
    return {.exposure = number, .start = h.now() + 1ms, .length = 200us};
}

std::uint64_t sum_of(const FrameLease& frame) {
    std::uint64_t sum = 0;
    for (int y = 0; y < frame.view().height_px; ++y) {
        for (int x = 0; x < frame.view().width_px; ++x) sum += frame.view().sample(x, y);
    }
    return sum;
}

TEST_P(SensorContract, says_its_format_before_it_is_started) {
    const auto format = h_->device().format();
    EXPECT_GT(format.width_px, 0);
    EXPECT_GT(format.height_px, 0);
    EXPECT_GE(format.bits, 8);
    EXPECT_LE(format.bits, 16);
    EXPECT_GE(format.buffers, 1);
}

TEST_P(SensorContract, a_trigger_brings_one_whole_frame_of_the_format_exposed_no_earlier_than_asked) {
    Ear ear;
    ASSERT_TRUE(h_->device().start(ear));
    const auto format = h_->device().format();
    std::uint32_t last = 0;
    for (std::uint32_t k = 1; k <= 3; ++k) {
        const ExposureRequest asked = exposure(*h_, k);
        ASSERT_TRUE(h_->device().trigger(asked));
        ASSERT_TRUE(h_->run_until([&] { return !ear.frames.empty(); }))
            << (ear.losses.empty() ? "not lost" : ear.losses[0].message());
        ASSERT_EQ(ear.frames.size(), 1U);
        const FrameLease frame = std::move(ear.frames[0]);
        ear.frames.clear();
        ASSERT_TRUE(frame);
        EXPECT_EQ(frame.view().width_px, format.width_px);
        EXPECT_EQ(frame.view().height_px, format.height_px);
        EXPECT_EQ(frame.view().bits, format.bits);
        EXPECT_GE(frame.view().stride_bytes, format.width_px * frame.view().sample_bytes());
        EXPECT_GE(frame.info().bytes_used,
                  static_cast<std::size_t>(format.width_px) * static_cast<std::size_t>(format.height_px) *
                      static_cast<std::size_t>(frame.view().sample_bytes()));
        EXPECT_FALSE(frame.info().corrupt);
        EXPECT_GE(frame.info().exposure_start, asked.start);
        EXPECT_LE(frame.info().exposure_start, h_->now());
        if (k > 1) {
            EXPECT_EQ(frame.info().sequence, last + 1);
        }
        last = frame.info().sequence;
    }
    h_->run_for(kQuiet);
    EXPECT_TRUE(ear.frames.empty());
    h_->device().stop();
}

// A free-running camera is triggered shortly after each of its frames began.
TEST_P(SensorContract, no_frame_is_taken_that_began_shortly_before_the_start_asked_for) {
    Ear ear;
    ASSERT_TRUE(h_->device().start(ear));
    std::uint32_t number = 0;
    const auto start_of = [&](const ExposureRequest& asked) -> TimePoint {
        EXPECT_TRUE(h_->device().trigger(asked));
        EXPECT_TRUE(h_->run_until([&] { return !ear.frames.empty(); }))
            << (ear.losses.empty() ? "not lost" : ear.losses[0].message());
        if (ear.frames.empty()) return {};
        const TimePoint began = ear.frames[0].info().exposure_start;
        ear.frames.clear();
        return began;
    };
    const TimePoint first = start_of(exposure(*h_, ++number));
    TimePoint last = start_of(exposure(*h_, ++number));
    const auto period = last - first;
    ASSERT_GT(period, 0ns);
    for (const auto after : {50us, 100us, 150us, 200us, 250us, 300us, 350us, 400us}) {
        const ExposureRequest asked{.exposure = ++number, .start = last + period + after, .length = 200us};
        last = start_of(asked);
        ASSERT_GE(last, asked.start) << after.count();
    }
    h_->device().stop();
}

TEST_P(SensorContract, it_is_not_triggered_before_start_after_stop_or_for_no_time) {
    Ear ear;
    EXPECT_EQ(code_of(h_->device().trigger(exposure(*h_, 1))), ErrorCode::disconnected);
    ASSERT_TRUE(h_->device().start(ear));
    EXPECT_EQ(code_of(h_->device().start(ear)), ErrorCode::invalid_argument);
    ExposureRequest none = exposure(*h_, 1);
    none.length = 0ns;
    EXPECT_EQ(code_of(h_->device().trigger(none)), ErrorCode::invalid_argument);
    h_->device().stop();
    EXPECT_EQ(code_of(h_->device().trigger(exposure(*h_, 1))), ErrorCode::disconnected);
}

TEST_P(SensorContract, it_is_busy_when_every_buffer_is_lent_until_one_is_given_back_on_whatever_thread) {
    Ear ear;
    ASSERT_TRUE(h_->device().start(ear));
    const auto buffers = static_cast<std::size_t>(h_->device().format().buffers);
    for (std::size_t k = 1; k <= buffers; ++k) {
        ASSERT_TRUE(h_->device().trigger(exposure(*h_, static_cast<std::uint32_t>(k)))) << k;
        ASSERT_TRUE(h_->run_until([&] { return ear.frames.size() == k; }));
    }
    EXPECT_EQ(code_of(h_->device().trigger(exposure(*h_, 99))), ErrorCode::busy);
    std::thread([frame = std::move(ear.frames.back())]() mutable { frame.give_back(); }).join();
    ear.frames.pop_back();
    ASSERT_TRUE(h_->run_until([&] { return h_->device().trigger(exposure(*h_, 100)).has_value(); }));
    EXPECT_TRUE(h_->run_until([&] { return ear.frames.size() == buffers; }));
    ear.frames.clear();
    h_->device().stop();
}

TEST_P(SensorContract, frames_on_loan_stay_readable_after_stop_and_may_be_given_back_then) {
    Ear ear;
    ASSERT_TRUE(h_->device().start(ear));
    ASSERT_TRUE(h_->device().trigger(exposure(*h_, 1)));
    ASSERT_TRUE(h_->run_until([&] { return !ear.frames.empty(); }));
    const std::uint64_t before = sum_of(ear.frames[0]);
    h_->device().stop();
    EXPECT_EQ(sum_of(ear.frames[0]), before);
    FrameLease moved = std::move(ear.frames[0]);
    EXPECT_EQ(sum_of(moved), before);
    ASSERT_TRUE(h_->device().start(ear));  // although one buffer is still lent
    EXPECT_EQ(sum_of(moved), before);
    moved.give_back();
    EXPECT_FALSE(moved);
    moved.give_back();
    ear.frames.clear();
    h_->device().stop();
}

TEST_P(SensorContract, nothing_is_heard_after_stop_and_a_restart_works) {
    Ear ear;
    h_->device().stop();
    ASSERT_TRUE(h_->device().start(ear));
    ASSERT_TRUE(h_->device().trigger(exposure(*h_, 1)));
    h_->device().stop();
    h_->run_for(kQuiet);
    EXPECT_TRUE(ear.frames.empty());
    ASSERT_TRUE(h_->device().start(ear));
    for (int k = 0; k < 2 * h_->device().format().buffers; ++k) {  // no buffer was lost
        ASSERT_TRUE(h_->device().trigger(exposure(*h_, 2)));
        ASSERT_TRUE(h_->run_until([&] { return !ear.frames.empty(); }));
        ear.frames.clear();
    }
    h_->device().stop();
}

TEST_P(SensorContract, it_may_be_stopped_from_its_own_callback) {
    Ear ear;
    ear.then = [&] { h_->device().stop(); };
    ASSERT_TRUE(h_->device().start(ear));
    ASSERT_TRUE(h_->device().trigger(exposure(*h_, 1)));
    ASSERT_TRUE(h_->run_until([&] { return !ear.frames.empty(); }));
    EXPECT_EQ(code_of(h_->device().trigger(exposure(*h_, 2))), ErrorCode::disconnected);
    (void)sum_of(ear.frames[0]);
    ear.frames.clear();
}

TEST_P(SensorContract, a_loss_is_told_once_triggers_fail_and_a_restart_recovers) {
    Ear ear;
    ASSERT_TRUE(h_->device().start(ear));
    if (!h_->lose()) GTEST_SKIP() << "a loss cannot be shown here";
    (void)h_->device().trigger(exposure(*h_, 1));
    ASSERT_TRUE(h_->run_until([&] { return !ear.losses.empty(); }));
    EXPECT_EQ(code_of(h_->device().trigger(exposure(*h_, 2))), ErrorCode::disconnected);
    h_->run_for(kQuiet);
    EXPECT_EQ(ear.losses.size(), 1U);
    EXPECT_FALSE(ear.losses[0].what.empty());
    ear.frames.clear();
    h_->device().stop();
    h_->bring_back();
    ASSERT_TRUE(h_->run_until([&] { return h_->device().start(ear).has_value(); }));
    ASSERT_TRUE(h_->device().trigger(exposure(*h_, 3)));
    EXPECT_TRUE(h_->run_until([&] { return !ear.frames.empty(); }));
    ear.frames.clear();
    h_->device().stop();
}

}  // namespace
}  // namespace hord::contract
