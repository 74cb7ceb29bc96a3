// Triggers, frames and their times; depths and packings.
#include <map>

#include "drivers/genicam/genicam_request.h"
#include "tests/drivers/genicam/genicam_fixture.h"

namespace hord::drivers {
namespace {

using test::FakeGige;
using testing::AllOf;
using testing::HasSubstr;

TEST(GenicamRequest, comes_back_unchanged_and_a_malformed_one_is_none) {
    const GenicamSensorOptions asked{.camera = "lens \"7\"",
                                     .width_px = 999,
                                     .height_px = 998,
                                     .offset_x_px = 4,
                                     .offset_y_px = 6,
                                     .bits = 12,
                                     .pixel_format = "Mono12p",
                                     .buffers = 5,
                                     .trigger = CameraTrigger::software,
                                     .trigger_source = "Line2",
                                     .packet_bytes = 8192,
                                     .socket_buffer_bytes = 1'000'000,
                                     .light_line = "Line3",
                                     .light_us = 250,
                                     .barrier_line = "Line1",
                                     .features = {{"LineSelector", "Line1"}, {"Gain", "1.5"}}};
    EXPECT_EQ(parse_genicam_request(request_of(asked)), asked);
    for (const std::string& wrong : {std::string(), std::string("{}"), request_of(asked).substr(1)})
        EXPECT_FALSE(parse_genicam_request(wrong));
}

// More frames than block ids of 16 bits have left: the fake camera begins near 65535.
TEST_F(Genicam, a_software_trigger_brings_the_next_frame_numbered_without_a_gap_and_stamped_within_its_exposure) {
    const FakeGige camera;
    start(software());
    std::uint32_t last_value = 0;
    for (std::uint32_t k = 1; k <= 150; ++k) {
        const hal::FrameLease one = frame();
        ASSERT_TRUE(one) << k;
        EXPECT_FALSE(one.info().corrupt);
        EXPECT_EQ(one.info().sequence, k);
        EXPECT_GE(one.info().exposure_start, asked_);
        EXPECT_LE(one.info().exposure_start, loop_->now());
        ASSERT_TRUE(is_one_frame(one.view()));
        if (k > 1) {
            EXPECT_EQ(one.view().sample(0, 0), (last_value + 1) & 255U);
        }
        last_value = one.view().sample(0, 0);
    }
}

// Every third frame is exposed while the next part's exposure is due.
TEST_F(Genicam, a_late_frame_answers_the_trigger_that_made_it) {
    const FakeGige camera({"127.0.0.1", "S1", "late=80"});
    start(software());
    std::map<std::uint32_t, hal::TimePoint> asked;
    int late = 0;
    for (std::uint32_t k = 1; k <= 12; ++k) {
        asked[k] = loop_->now() + 1ms;
        (void)sensor_->trigger({.exposure = k, .start = asked[k], .length = 1ms});
        run_until([&] { return !ear_.frames.empty(); }, 40ms);
        for (const hal::FrameLease& one : ear_.frames) {
            const hal::Duration after = one.info().exposure_start - asked.at(one.info().exposure);
            const bool is_late = one.view().sample(0, 0) % 3 == 2;
            EXPECT_GE(after, is_late ? 80ms : 0ms) << k << " " << one.info().exposure;
            late += is_late ? 1 : 0;
        }
        ear_.frames.clear();
    }
    EXPECT_GT(late, 0);
}

// Every frame is longer on its way than the next command waits; its time stamp is as late, for all that the station
// knows.
TEST_F(Genicam, whose_clock_is_unknown_gives_a_frame_that_is_too_late_to_nobody) {
    const FakeGige camera({"127.0.0.1", "S1", "latch=no", "delay=1300"});
    start(software());
    ear_.commands = false;
    const auto command = [&](std::uint32_t exposure) {
        EXPECT_TRUE(sensor_->trigger({.exposure = exposure, .start = loop_->now(), .length = 1ms}));
    };
    command(1);
    run_until([] { return false; }, CameraSensor::kPatience + 50ms);
    ASSERT_TRUE(ear_.frames.empty());
    command(2);
    ASSERT_TRUE(run_until([&] { return !ear_.frames.empty(); }));
    EXPECT_TRUE(ear_.frames[0].info().nobodys) << "exposure " << ear_.frames[0].info().exposure;
}

// The first packet says another width, place, format or padding than was agreed, or does not come.
TEST_F(Genicam, whose_frames_are_not_what_was_agreed_gives_damaged_ones_and_says_what_differs) {
    constexpr std::uint32_t kBayerRg8 = 0x0108'0009;
    for (const auto& [at, value, what] :
         std::vector<std::tuple<int, std::uint32_t, std::string>>{{24, 60, "another size"},
                                                                  {32, 9, "another place on the sensor"},
                                                                  {20, kBayerRg8, "another format"},
                                                                  {40, 0x0004'0000, "padded"},
                                                                  {4, 0x0FFF'FFFF, ""}}) {
        const FakeGige camera({"127.0.0.1", "S1", "leader=" + std::to_string(at) + ":" + std::to_string(value)});
        testing::internal::CaptureStderr();
        start(software());
        for (int k = 0; k < 3; ++k) {
            const hal::FrameLease one = frame();
            EXPECT_TRUE(one) << what;
            if (!one) break;
            EXPECT_TRUE(one.info().corrupt) << what;
            EXPECT_EQ(one.info().exposure, 1U) << what;
            EXPECT_LE(loop_->now() - one.info().exposure_start, 30s) << what;
        }
        sensor_->stop();
        const std::string said = testing::internal::GetCapturedStderr();
        EXPECT_THAT(said, AllOf(HasSubstr("a frame is damaged: "), HasSubstr(what)));
        if (!what.empty()) {
            EXPECT_THAT(said, AllOf(HasSubstr("size and region"), testing::Not(HasSubstr("rmem_max"))));
        }
    }
}

// Larger than net.core.rmem_default: the socket must have its buffer before the first packet.
TEST_F(Genicam, the_first_frame_after_a_start_is_whole) {
    int rmem_max = 0;
    std::ifstream("/proc/sys/net/core/rmem_max") >> rmem_max;
    if (rmem_max < 3'000'000) GTEST_SKIP() << "this kernel gives a socket less than some frames";
    const FakeGige camera;
    for (int k = 0; k < 5; ++k) {
        start(software(1024, 1024));
        const hal::FrameLease one = frame();
        ASSERT_TRUE(one) << k;
        EXPECT_FALSE(one.info().corrupt) << k;
        ear_.frames.clear();
        sensor_->stop();
    }
}

// Firmware that goes from block 65535 to 0, not to 1.
TEST_F(Genicam, whose_firmware_has_a_block_0_gives_its_frames_all_the_same) {
    const FakeGige camera({"127.0.0.1", "S1", "block-zero"});
    start(software());
    std::uint32_t last_value = 0;
    for (std::uint32_t k = 1; k <= 8; ++k) {
        const hal::FrameLease one = frame();
        ASSERT_TRUE(one) << k;
        EXPECT_FALSE(one.info().corrupt) << k;
        EXPECT_EQ(one.info().sequence, k);
        if (k > 1) {
            EXPECT_EQ(one.view().sample(0, 0), (last_value + 1) & 255U);
        }
        last_value = one.view().sample(0, 0);
    }
    EXPECT_TRUE(ear_.losses.empty());
}

TEST_F(Genicam, every_depth_and_packing_gives_the_cameras_samples) {
    const FakeGige camera;
    for (const auto& [bits, format, used] :
         std::vector<std::tuple<int, std::string, std::size_t>>{{10, "", 2},
                                                                {10, "Mono10p", 2},
                                                                {10, "Mono10Packed", 2},
                                                                {12, "", 2},
                                                                {12, "Mono12p", 2},
                                                                {12, "Mono12Packed", 2},
                                                                {16, "", 2}}) {
        GenicamSensorOptions options = software(60, 35);
        options.bits = bits;
        options.pixel_format = format;
        start(options);
        const hal::FrameLease one = frame();
        ASSERT_TRUE(one) << format;
        EXPECT_EQ(one.view().bits, bits);
        EXPECT_EQ(one.info().bytes_used, 60U * 35 * used);
        EXPECT_TRUE(is_one_frame(one.view())) << bits << format;
        sensor_->stop();
    }
}

// Free-running, and a clock that cannot be latched.
TEST_F(Genicam, that_runs_free_answers_a_trigger_with_a_frame_that_began_after_it) {
    for (const std::string latch : {"latch=yes", "latch=no"}) {
        const FakeGige camera(latch == "latch=no" ? std::vector<std::string>{"127.0.0.1", "S1", latch}
                                                  : std::vector<std::string>{"127.0.0.1", "S1"});
        GenicamSensorOptions options = software();
        options.trigger = CameraTrigger::free;
        start(options);
        for (int k = 0; k < 5; ++k) {
            const hal::FrameLease one = frame();
            ASSERT_TRUE(one);
            EXPECT_GE(one.info().exposure_start, asked_);
            EXPECT_LE(one.info().exposure_start, loop_->now());
        }
        sensor_->stop();
    }
}

}  // namespace
}  // namespace hord::drivers
