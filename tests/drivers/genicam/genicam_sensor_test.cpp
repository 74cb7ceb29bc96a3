// The sensor of a GenICam camera on a fake GigE camera, over the real protocol: two processes and a network between
// them. tests/system/contract tests the sensor's contract.
#include "drivers/genicam/genicam_sensor.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <map>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include "common/unique_fd.h"
#include "drivers/camera_process/camera_part_sensor.h"
#include "drivers/camera_process/camera_strobe.h"
#include "drivers/event_loop/event_loop_sd.h"
#include "drivers/genicam/genicam_request.h"
#include "tests/drivers/genicam/fake_gige.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;
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
bool is_one_frame(const FrameView& view) {
    const std::uint32_t first = view.sample(0, 0);
    for (int y = 0; y < view.height_px; ++y) {
        for (int x = 0; x < view.width_px; ++x) {
            if (view.sample(x, y) != ((first + static_cast<std::uint32_t>(x + 3 * y)) & view.full_scale()))
                return false;
        }
    }
    return true;
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

TEST_F(Genicam, a_socket_buffer_above_what_the_kernel_gives_is_refused_before_the_start) {
    const FakeGige camera;
    GenicamSensorOptions options = software();
    options.socket_buffer_bytes = 1 << 30;
    const Error error = refusal(options);
    EXPECT_THAT(error.message(),
                AllOf(HasSubstr("sensor.socket_buffer_bytes"), HasSubstr("sysctl net.core.rmem_max=1073741824")));
}

TEST_F(Genicam, a_negotiated_packet_size_does_not_depend_on_what_was_set_before) {
    const FakeGige camera;
    testing::internal::CaptureStderr();
    GenicamSensorOptions options = software();
    options.packet_bytes = 576;
    start(options);
    sensor_->stop();
    options.packet_bytes = 0;
    start(options);
    sensor_->stop();
    const std::string said = testing::internal::GetCapturedStderr();
    EXPECT_THAT(said,
                AllOf(HasSubstr("packets of 576 bytes (as configured)"), HasSubstr("bytes (negotiated)"),
                      testing::Not(HasSubstr("packets of 576 bytes (negotiated)"))));
}

// A way that carries jumbo frames, and one that does not.
TEST_F(Genicam, the_largest_packet_that_passes_is_negotiated_and_frames_of_it_are_whole) {
    for (const int mtu : {9000, 1500}) {
        const FakeGige camera({"127.0.0.1", "S1", "test-packets", "mtu=" + std::to_string(mtu)});
        testing::internal::CaptureStderr();
        start(software(320, 240));
        const hal::FrameLease one = frame();
        sensor_->stop();
        EXPECT_THAT(testing::internal::GetCapturedStderr(),
                    HasSubstr("packets of " + std::to_string(mtu) + " bytes (negotiated)"));
        ASSERT_TRUE(one);
        EXPECT_FALSE(one.info().corrupt);
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

TEST_F(Genicam, a_camera_is_named_by_serial_number_user_defined_name_address_or_id) {
    const FakeGige camera({"127.0.0.1", "S1", "name=lens-7"});
    for (const char* name : {"S1", "lens-7", "127.0.0.1", "Aravis-Fake-S1", ""}) {
        GenicamSensorOptions options = software();
        options.camera = name;
        const auto opened = open(options);
        EXPECT_TRUE(opened) << name << ": " << opened.error().message();
    }
    GenicamSensorOptions options = software();
    options.camera = "S2";
    const Error absent = refusal(options);
    EXPECT_EQ(absent.code, ErrorCode::not_found);
    EXPECT_THAT(absent.what, AllOf(HasSubstr("\"S2\""), HasSubstr("serial S1, name \"lens-7\", at 127.0.0.1")));
}

// Its answer to the first discovery is lost.
TEST_F(Genicam, that_did_not_hear_the_first_discovery_is_found_by_the_second) {
    const FakeGige camera({"127.0.0.1", "S1", "asleep=500"});
    start(software());
    EXPECT_TRUE(frame());
}

TEST_F(Genicam, no_camera_and_a_damaged_description_are_said_with_a_cure) {
    const Error none = refusal(software());
    EXPECT_EQ(none.code, ErrorCode::not_found);
    EXPECT_THAT(none.message(), AllOf(HasSubstr("no GenICam camera is there"), HasSubstr("cable")));
    const FakeGige camera({"127.0.0.1", "S1", "broken-xml"});
    const Error broken = refusal(software());
    EXPECT_EQ(broken.code, ErrorCode::unsupported) << broken.message();
    EXPECT_THAT(broken.message(), AllOf(HasSubstr("XML"), HasSubstr("firmware")));
}

// Two cameras on two addresses of one host; both have the same user-defined name.
TEST_F(Genicam, of_two_cameras_one_is_named_and_a_name_that_both_have_is_refused) {
    ASSERT_EQ(std::system("ip address add 127.0.0.2/8 dev lo && ip address add 127.0.0.3/8 dev lo"), 0);
    const FakeGige one({"127.0.0.1", "S1", "name=lens"}), two({"127.0.0.2", "S2", "name=lens"});
    GenicamSensorOptions options = software();
    const Error unnamed = refusal(options);
    EXPECT_EQ(unnamed.code, ErrorCode::invalid_argument);
    EXPECT_THAT(unnamed.message(), AllOf(HasSubstr("S1"), HasSubstr("S2"), HasSubstr("sensor.camera")));
    options.camera = "lens";
    const Error both = refusal(options);
    EXPECT_EQ(both.code, ErrorCode::invalid_argument);
    EXPECT_THAT(both.what, HasSubstr("several cameras are called \"lens\""));
    {
        const FakeGige deaf({"127.0.0.3", "S3", "name=lens", "lose-answers=2"});
        EXPECT_THAT(refusal(options).what, AllOf(HasSubstr("several cameras are called \"lens\""), HasSubstr("S3")));
    }
    {
        const FakeGige mute({"127.0.0.3", "S3", "name=lens-3", "lose-answers=1000"});
        options.camera = "lens-3";
        EXPECT_THAT(refusal(options).message(), AllOf(HasSubstr("serial S3"), HasSubstr("does not say whether")));
    }
    options.camera = "S2";
    start(options);
    EXPECT_TRUE(frame());
}

TEST_F(Genicam, what_the_camera_does_not_have_is_refused_with_what_it_has) {
    const FakeGige camera;
    const auto with = [](const std::string& name, const std::string& value) {
        GenicamSensorOptions options = software();
        options.features = {{name, value}};
        return options;
    };
    const Error unknown = refusal(with("ExposureTimeAps", "500"));
    EXPECT_EQ(unknown.code, ErrorCode::unsupported);
    EXPECT_THAT(unknown.message(), AllOf(HasSubstr("ExposureTimeAps"), HasSubstr("did you mean ExposureTimeAbs?")));
    EXPECT_THAT(refusal(with("ExposureTimeAbs", "-1")).message(), AllOf(HasSubstr("-1"), HasSubstr(" to ")));
    EXPECT_THAT(refusal(with("GainRaw", "1.5")).message(), AllOf(HasSubstr("GainRaw"), HasSubstr(" to ")));
    EXPECT_THAT(refusal(with("GainAuto", "Sometimes")).message(), HasSubstr("one of Off, Once, Continuous"));
    EXPECT_THAT(refusal(with("TestBoolean", "2")).message(), HasSubstr("true or false"));
    EXPECT_THAT(refusal(with("SensorHeight", "100")).message(),
                AllOf(HasSubstr("SensorHeight can only be read"), HasSubstr("take it out")));
    GenicamSensorOptions options = software();
    options.width_px = 100'000;
    EXPECT_THAT(refusal(options).message(), AllOf(HasSubstr("Width"), HasSubstr(" to 2048")));
    options = software();
    options.bits = 16;
    options.pixel_format = "Mono8";
    EXPECT_THAT(refusal(options).message(), AllOf(HasSubstr("Mono8"), HasSubstr("16 bits")));
    options = software();
    options.trigger = CameraTrigger::line;
    options.trigger_source = "Line9";
    EXPECT_THAT(refusal(options).message(), AllOf(HasSubstr("TriggerSource"), HasSubstr("Line0, Software")));
    // And what it has is set.
    options = software();
    options.features = {{"ExposureTimeAbs", "500"}, {"GainRaw", "3"}, {"GainAuto", "Off"}, {"TestBoolean", "true"}};
    options.packet_bytes = 1200;
    start(options);
    EXPECT_TRUE(frame());
}

TEST_F(Genicam, what_is_no_value_of_a_feature_is_refused_with_what_it_takes) {
    const FakeGige camera;
    struct Case {
        const char *name, *value, *what, *cure;
    };
    const Case cases[] = {
        {"AnalogControl", "1", "AnalogControl is a category", "name one of its features"},
        {"ExposureTimeAbs", "nan", "cannot be \"nan\"", " to "},
        {"GainRaw", "3.0", "cannot be \"3.0\"", "use a whole number, 0 to 10"},
        {"GainRaw", "11", "cannot be \"11\"", "use a whole number, 0 to 10"},
        {"AcquisitionStop", "false", "cannot be \"false\"", "use true: it is a command"},
        {"Gain", "3", "no feature \"Gain\"", "did you mean GainRaw?"},
    };
    for (const Case& one : cases) {
        GenicamSensorOptions options = software();
        options.features = {{one.name, one.value}};
        const Error said = refusal(options);
        EXPECT_THAT(said.what, HasSubstr(one.what)) << one.value;
        EXPECT_THAT(said.cure, HasSubstr(one.cure)) << one.name << " = " << one.value;
    }
}

TEST_F(Genicam, that_has_no_format_of_the_bits_is_refused_with_its_formats) {
    const FakeGige camera({"127.0.0.1", "S1", "formats=8"});
    GenicamSensorOptions options = software();
    options.bits = 12;
    EXPECT_THAT(refusal(options).message(), AllOf(HasSubstr("Mono8"), HasSubstr("Mono16"), HasSubstr("sensor.bits")));
}

TEST_F(Genicam, that_another_program_controls_is_busy_with_a_cure) {
    const FakeGige camera;
    start(software());
    ASSERT_TRUE(frame());
    const auto second = open_genicam_sensor(*loop_, software());
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, ErrorCode::busy) << second.error().message();
    EXPECT_THAT(second.error().cure, HasSubstr("close the program"));
    EXPECT_TRUE(frame()) << "the first goes on" << (ear_.losses.empty() ? "" : ear_.losses[0].message());
}

// A frame with missing packets is corrupt or missing; none is another one's: the
// samples count the frames as the sequence does.
TEST_F(Genicam, frames_with_lost_packets_are_corrupt_or_missing_and_none_is_taken_for_another) {
    const FakeGige camera({"127.0.0.1", "S1", "lost=0.01"});
    start(software(320, 240));  // 58 packets: about every second frame is complete
    int corrupt = 0, whole = 0;
    std::optional<std::uint8_t> ahead;  // of the sequence: the camera's own number of the frame, its first sample
    std::uint32_t last = 0;
    for (int k = 0; k < 40 && ear_.losses.empty(); ++k) {
        const hal::FrameLease one = frame(1900ms);
        if (!one) continue;
        EXPECT_GT(one.info().sequence, last);
        last = one.info().sequence;
        EXPECT_TRUE(one.info().corrupt ? one.info().bytes_used == 0 : is_one_frame(one.view()));
        if (one.info().corrupt) {
            ++corrupt;
            continue;
        }
        ++whole;
        // A trigger that is sent again on a busy machine makes the camera count on. A frame taken for a later one lags.
        const auto now_ahead = static_cast<std::uint8_t>(one.view().sample(0, 0) - one.info().sequence);
        EXPECT_LT(static_cast<std::uint8_t>(now_ahead - ahead.value_or(now_ahead)), 128);
        ahead = now_ahead;
    }
    EXPECT_TRUE(ear_.losses.empty()) << ear_.losses[0].message();
    EXPECT_GT(corrupt, 0);
    EXPECT_GT(whole, 1);
}

// Every frame loses some. Aravis asks for a quarter of a frame's packets at most: where a busy machine keeps more of
// them back, that frame is damaged.
TEST_F(Genicam, lost_packets_come_again_when_they_are_asked_for_and_are_counted) {
    const FakeGige camera({"127.0.0.1", "S1", "resend=10"});
    testing::internal::CaptureStderr();
    start(software(320, 240));
    int whole = 0;
    for (std::uint32_t k = 1; k <= 12; ++k) {
        const hal::FrameLease one = frame();
        ASSERT_TRUE(one) << k;
        EXPECT_EQ(one.info().sequence, k);
        EXPECT_TRUE(one.info().corrupt || is_one_frame(one.view())) << k;
        whole += one.info().corrupt ? 0 : 1;
    }
    sensor_->stop();
    const std::string said = testing::internal::GetCapturedStderr();
    EXPECT_GE(whole, 8) << said;
    EXPECT_THAT(said, HasSubstr("lost packets are asked for again\n"));
    EXPECT_THAT(said, testing::ContainsRegex("frames complete, .*; [1-9][0-9]+ packets sent again, "));
}

// The rest of each third frame comes when it is asked for; one packet never does.
TEST_F(Genicam, a_packet_that_never_comes_makes_its_frame_damaged_and_is_told) {
    const FakeGige camera({"127.0.0.1", "S1", "resend=10", "never=25"});
    testing::internal::CaptureStderr();
    start(software(320, 240));
    int corrupt = 0;
    for (std::uint32_t k = 1; k <= 9; ++k) {
        const hal::FrameLease one = frame();
        ASSERT_TRUE(one) << k;
        EXPECT_EQ(one.info().sequence, k);
        EXPECT_TRUE(one.info().corrupt ? one.info().bytes_used == 0 : is_one_frame(one.view())) << k;
        if (one.info().corrupt) ++corrupt;
    }
    sensor_->stop();
    const std::string said = testing::internal::GetCapturedStderr();
    EXPECT_THAT(corrupt, AllOf(testing::Ge(2), testing::Le(6))) << said;
    EXPECT_THAT(said,
                HasSubstr("a frame is damaged: packets of it did not come, although lost ones are asked for again\n"));
    EXPECT_THAT(said, testing::ContainsRegex("[1-9] incomplete, .*; [1-9][0-9]+ packets sent again, [1-9]"));
}

// Packets that come late and out of turn belong to their frames all the same.
TEST_F(Genicam, frames_whose_packets_are_late_and_out_of_turn_are_whole) {
    for (const char* network : {"reorder=5", "delay=30"}) {
        const FakeGige camera({"127.0.0.1", "S1", network});
        start(software(320, 240));
        for (std::uint32_t k = 1; k <= 20; ++k) {
            const hal::FrameLease one = frame();
            ASSERT_TRUE(one) << network << k;
            EXPECT_FALSE(one.info().corrupt) << network << k;
            EXPECT_EQ(one.info().sequence, k);
            EXPECT_TRUE(is_one_frame(one.view())) << network << k;
            EXPECT_GE(one.info().exposure_start, asked_);  // by the camera's clock: a delay does not count
            EXPECT_LE(one.info().exposure_start, loop_->now());
        }
        sensor_->stop();
    }
}

// The same by the kernel, where it has netem.
TEST_F(Genicam, frames_are_whole_behind_netem) {
    if (std::system("tc qdisc replace dev lo root netem delay 2ms 1ms reorder 25% 2>/dev/null") != 0)
        GTEST_SKIP() << "this kernel has no netem (CONFIG_NET_SCH_NETEM), or this user may not use it";
    const FakeGige camera;
    start(software(320, 240));
    for (std::uint32_t k = 1; k <= 20; ++k) {
        const hal::FrameLease one = frame();
        ASSERT_TRUE(one) << k;
        EXPECT_EQ(one.info().sequence, k);
        EXPECT_TRUE(!one.info().corrupt && is_one_frame(one.view())) << k;
    }
    EXPECT_EQ(std::system("tc qdisc del dev lo root"), 0);
}

TEST_F(Genicam, says_at_the_start_how_long_it_exposes_and_that_the_socket_buffer_is_less_than_a_frame) {
    const FakeGige camera({"127.0.0.1", "S1", "size=6000x6000"});
    testing::internal::CaptureStderr();
    GenicamSensorOptions options = software(6000, 6000);
    options.exposure_us = 500;
    options.features = {{"ExposureTimeAbs", "500"}};
    options.buffers = 2;
    start(options);
    sensor_->stop();
    options.features = {{"ExposureTimeAbs", "10000"}};
    start(options);
    sensor_->stop();
    const std::string said = testing::internal::GetCapturedStderr();
    EXPECT_THAT(said, HasSubstr("it exposes for 500 us\n"));
    EXPECT_THAT(said,
                HasSubstr("exposes for 10000 us, and timing.exposure_us is 500: set ExposureTimeAbs in "
                          "[[sensor.feature]]"));
    int rmem_max = 0;
    std::ifstream("/proc/sys/net/core/rmem_max") >> rmem_max;
    if (rmem_max >= 6000 * 6000) GTEST_SKIP() << "this kernel gives a socket more than a frame";
    EXPECT_THAT(said, AllOf(HasSubstr("less than a frame"), HasSubstr("raise net.core.rmem_max")));
}

// A switch that drops what is larger than its MTU.
TEST_F(Genicam, behind_a_small_mtu_a_packet_size_that_does_not_pass_gives_damaged_frames_and_is_said_with_the_cure) {
    const FakeGige camera({"127.0.0.1", "S1", "mtu=1500"});
    for (const int packet_bytes : {0, 9000}) {  // negotiated; as a person set it
        testing::internal::CaptureStderr();
        GenicamSensorOptions options = software(320, 240);
        options.packet_bytes = packet_bytes;
        start(options);
        int corrupt = 0, whole = 0;
        for (int k = 0; k < 4; ++k) {
            const hal::FrameLease one = frame();
            ASSERT_TRUE(one);
            ++(one.info().corrupt ? corrupt : whole);
        }
        sensor_->stop();
        const std::string said = testing::internal::GetCapturedStderr();
        if (packet_bytes == 0) {
            EXPECT_EQ(corrupt, 0);
            EXPECT_THAT(said, testing::Not(HasSubstr("none of the first")));
        } else {
            EXPECT_EQ(whole, 0);
            EXPECT_THAT(said,
                        AllOf(HasSubstr("none of the first 3 frames was complete"), HasSubstr("9000 bytes"),
                              HasSubstr("sensor.packet_bytes to 0"), HasSubstr("MTU")));
        }
    }
}

struct LightEar final : hal::Strobe::Listener {
    void on_strobe(const hal::StrobeReport& report) override { reports.push_back(report); }
    void on_strobe_lost(const Error& error) override { losses.push_back(error); }
    std::vector<hal::StrobeReport> reports;
    std::vector<Error> losses;
};

// The camera's output is set to its exposures; the pulse makes it expose, and the frame is the light's report.
TEST_F(Genicam, its_own_light_is_fired_by_the_strobe_and_reported_by_the_frame) {
    const FakeGige camera({"127.0.0.1", "S1", "lines"});
    GenicamSensorOptions options = software();
    options.light_line = "Line2";
    options.light_us = 200'000;
    start(options);
    CameraStrobe light(*loop_, *sensor_, {200ms, 100ms, 1}, 200ms);
    LightEar ear;
    ASSERT_TRUE(light.start(ear));
    // The sensor alone lights nothing, and so brings no frame.
    ASSERT_TRUE(sensor_->trigger({.exposure = 1, .start = loop_->now() + 1ms, .length = 200ms}));
    loop_->run_until([] { return false; }, 300ms);
    EXPECT_TRUE(ear_.frames.empty());
    const hal::TimePoint start_at = loop_->now() + 5ms;
    ASSERT_TRUE(light.fire({7, 1, start_at, 200ms}));
    EXPECT_EQ(light.fire({8, 1, start_at + 250ms, 200ms}).error().code, ErrorCode::busy);
    EXPECT_EQ(light.fire({8, 1, start_at + 1s, 100ms}).error().code, ErrorCode::invalid_argument);
    ASSERT_TRUE(run_until([&] { return !ear.reports.empty() && !ear_.frames.empty(); }));
    EXPECT_TRUE(ear.reports[0].lit);
    EXPECT_EQ(ear.reports[0].exposure, 7U);
    EXPECT_EQ(ear.reports[0].start, ear_.frames[0].info().exposure_start);  // the same exposure
    EXPECT_EQ(ear.reports[0].width, 200ms);
    light.stop();
}

TEST_F(Genicam, an_output_or_a_length_that_the_camera_has_not_is_refused_for_its_light) {
    const FakeGige camera({"127.0.0.1", "S1", "lines"});
    GenicamSensorOptions options = software();
    options.light_line = "Line7";
    options.light_us = 500;
    EXPECT_THAT(refusal(options).message(), AllOf(HasSubstr("LineSelector"), HasSubstr("Line1, Line2")));
    options.light_line = "Line2";
    options.light_us = 100'000'000'000;
    EXPECT_THAT(refusal(options).message(), AllOf(HasSubstr("ExposureTimeAbs"), HasSubstr(" to ")));
}

TEST_F(Genicam, a_camera_without_outputs_cannot_light) {
    const FakeGige camera;
    GenicamSensorOptions options = software();
    options.light_line = "Line2";
    options.light_us = 500;
    EXPECT_THAT(refusal(options).message(), HasSubstr("LineSelector"));
}

TEST_F(Genicam, its_light_without_a_frame_is_not_lit_and_a_lost_camera_is_a_lost_light) {
    FakeGige camera({"127.0.0.1", "S1", "lines", "mtu=20"});  // no packet passes
    GenicamSensorOptions options = software();
    options.light_line = "Line2";
    options.light_us = 20'000;
    start(options);
    CameraStrobe light(*loop_, *sensor_, {20ms, 10ms, 1}, 20ms);
    LightEar ear;
    ASSERT_TRUE(light.start(ear));
    ASSERT_TRUE(light.fire({1, 1, loop_->now() + 5ms, 20ms}));
    ASSERT_TRUE(run_until([&] { return !ear.reports.empty(); }));
    EXPECT_FALSE(ear.reports[0].lit);
    ASSERT_TRUE(light.fire({2, 1, loop_->now() + 20s, 20ms}));
    camera.lose();
    ASSERT_TRUE(run_until([&] { return !ear.losses.empty(); }, 60s));
    ASSERT_EQ(ear.reports.size(), 2U);
    EXPECT_FALSE(ear.reports[1].lit);
    EXPECT_EQ(light.fire({3, 1, loop_->now() + 30s, 20ms}).error().code, ErrorCode::disconnected);
    light.stop();
}

// The wire exposes, and nothing else: the fake camera ignores software triggers here.
TEST_F(Genicam, that_a_wire_triggers_brings_a_frame_for_each_pulse_of_it) {
    FakeGige camera({"127.0.0.1", "S1", "wire"});
    GenicamSensorOptions options = software();
    options.trigger = CameraTrigger::line;
    options.trigger_source = "Line1";
    start(options);
    ASSERT_TRUE(sensor_->trigger({.exposure = 1, .start = loop_->now(), .length = 1ms}));
    run_until([&] { return !ear_.frames.empty(); }, 200ms);
    EXPECT_TRUE(ear_.frames.empty()) << "without a pulse";
    for (std::uint32_t k = 1; k <= 5; ++k) {
        const hal::TimePoint asked = loop_->now();
        if (k > 1) {
            ASSERT_TRUE(sensor_->trigger({.exposure = k, .start = asked, .length = 1ms}));
        }
        camera.set_input(true);
        ASSERT_TRUE(run_until([&] { return !ear_.frames.empty(); })) << k;
        EXPECT_EQ(ear_.frames[0].info().sequence, k);
        EXPECT_GE(ear_.frames[0].info().exposure_start, asked);
        EXPECT_LE(ear_.frames[0].info().exposure_start, loop_->now());
        EXPECT_TRUE(is_one_frame(ear_.frames[0].view()));
        ear_.frames.clear();
        camera.set_input(false);
    }
}

struct BarrierEar final : hal::PartSensor::Listener {
    void on_edge(const hal::PartEdge& edge) override { edges.push_back(edge); }
    void on_encoder(const hal::EncoderReading&) override {}
    void on_part_sensor_lost(const Error& error) override { losses.push_back(error); }
    std::vector<hal::PartEdge> edges;
    std::vector<Error> losses;
};

class GenicamBarrier : public Genicam {
  protected:
    static GenicamSensorOptions with_barrier() {
        GenicamSensorOptions options = software();
        options.barrier_line = "Line1";
        return options;
    }
    void listen(bool active_low = false) {
        ASSERT_TRUE(sensor_);
        barrier_ = std::make_unique<CameraPartSensor>(*loop_, *sensor_, active_low);
        ASSERT_TRUE(barrier_->start(ear_of_barrier_));
    }
    void TearDown() override {
        barrier_.reset();
        Genicam::TearDown();
    }
    // Edges one after the other, from an active one; each is awaited, but the `lost`-th.
    void pass_edges(FakeGige& camera, std::size_t count, std::size_t lost = 0) {
        std::size_t expected = ear_of_barrier_.edges.size();
        for (std::size_t k = 1; k <= count; ++k) {
            camera.set_input(k % 2 == 1);
            if (k != lost) ++expected;
            ASSERT_TRUE(run_until([&] { return ear_of_barrier_.edges.size() >= expected; })) << k;
            if (k == lost) run_until([] { return false; }, 100ms);
        }
    }
    std::vector<std::uint32_t> sequences() const {
        std::vector<std::uint32_t> out;
        for (const hal::PartEdge& edge : ear_of_barrier_.edges) out.push_back(edge.sequence);
        return out;
    }
    std::unique_ptr<CameraPartSensor> barrier_;
    BarrierEar ear_of_barrier_;
};

// The request numbers of the fake camera's messages begin near 65535.
TEST_F(GenicamBarrier, edges_are_told_with_the_cameras_time_and_without_a_gap) {
    for (const char* numbers : {"events", "events=value"}) {
        FakeGige camera({"127.0.0.1", "S1", numbers});
        start(with_barrier());
        listen();
        ASSERT_FALSE(HasFatalFailure());
        const hal::TimePoint before = loop_->now();
        pass_edges(camera, 8);
        EXPECT_EQ(sequences(), (std::vector<std::uint32_t>{1, 2, 3, 4, 5, 6, 7, 8})) << numbers;
        for (std::size_t k = 0; k < 8; ++k) {
            const hal::PartEdge& edge = ear_of_barrier_.edges[k];
            EXPECT_EQ(edge.kind, k % 2 == 0 ? hal::PartEdge::Kind::arrives : hal::PartEdge::Kind::leaves);
            EXPECT_GE(edge.at, (k == 0 ? before : ear_of_barrier_.edges[k - 1].at) - 50ms);
            EXPECT_LE(edge.at, loop_->now());
        }
        EXPECT_TRUE(frame()) << "frames come beside edges";
        barrier_.reset();
        ear_of_barrier_.edges.clear();
        sensor_->stop();
    }
}

TEST_F(GenicamBarrier, a_lost_message_leaves_a_gap_and_one_that_comes_twice_is_one_edge) {
    FakeGige camera({"127.0.0.1", "S1", "events", "twice", "lose-event=3"});
    start(with_barrier());
    listen();
    ASSERT_FALSE(HasFatalFailure());
    pass_edges(camera, 6, 3);
    EXPECT_EQ(sequences(), (std::vector<std::uint32_t>{1, 2, 4, 5, 6}));
}

TEST_F(GenicamBarrier, of_an_input_that_is_active_low_a_falling_edge_is_an_arrival) {
    FakeGige camera({"127.0.0.1", "S1", "events"});
    start(with_barrier());
    listen(true);
    ASSERT_FALSE(HasFatalFailure());
    pass_edges(camera, 2);
    EXPECT_EQ(ear_of_barrier_.edges[0].kind, hal::PartEdge::Kind::leaves);
    EXPECT_EQ(ear_of_barrier_.edges[1].kind, hal::PartEdge::Kind::arrives);
}

TEST_F(GenicamBarrier, a_camera_that_cannot_tell_the_edges_is_refused_with_a_cure) {
    {
        const FakeGige camera;
        EXPECT_THAT(refusal(with_barrier()).message(), AllOf(HasSubstr("no events"), HasSubstr("GPIO line")));
    }
    const FakeGige camera({"127.0.0.1", "S1", "events"});
    GenicamSensorOptions options = with_barrier();
    options.barrier_line = "Line7";
    EXPECT_THAT(refusal(options).message(), AllOf(HasSubstr("EventSelector"), HasSubstr("Line1RisingEdge")));
}

TEST_F(Genicam, that_leaves_is_lost_and_runs_again_when_it_is_back) {
    FakeGige camera;
    start(software());
    ASSERT_TRUE(frame());
    camera.lose();
    ASSERT_TRUE(sensor_->trigger({.exposure = 2, .start = loop_->now() + 1ms, .length = 1ms}));
    ASSERT_TRUE(run_until([&] { return !ear_.losses.empty(); }));
    EXPECT_FALSE(ear_.losses[0].what.empty());
    sensor_->stop();
    EXPECT_EQ(sensor_->start(ear_).error().code, ErrorCode::not_found);
    camera.bring_back();
    const auto started = sensor_->start(ear_);
    ASSERT_TRUE(started) << started.error().message();
    EXPECT_TRUE(frame());
}

TEST_F(Genicam, that_leaves_while_nothing_asks_for_frames_is_lost_too) {
    for (const char* clock : {"still", "latch=no"}) {
        FakeGige camera({"127.0.0.1", "S1", clock});
        start(software());
        camera.lose();
        ear_.losses.clear();
        ASSERT_TRUE(run_until([&] { return !ear_.losses.empty(); })) << clock;
        EXPECT_THAT(ear_.losses[0].what, HasSubstr("it does not answer")) << clock;
    }
}

// The UDP ports of this network but the camera's control port: those of hord-genicam and of the camera's stream.
std::vector<std::uint16_t> open_ports() {
    std::ifstream table("/proc/thread-self/net/udp");
    std::vector<std::uint16_t> ports;
    std::string line;
    for (std::getline(table, line); std::getline(table, line);) {
        unsigned port = 0;
        if (std::sscanf(line.c_str(), " %*d: %*x:%x", &port) == 1 && port != 3956)
            ports.push_back(static_cast<std::uint16_t>(port));
    }
    return ports;
}

// Whatever arrives at the sockets of hord-genicam: frames go on, or the camera is lost and comes back. It may end the
// process (Aravis), never this one.
TEST_F(Genicam, garbage_on_its_network_costs_the_camera_at_most) {
    const FakeGige camera({"127.0.0.1", "S1", "events"});
    GenicamSensorOptions options = software();
    options.barrier_line = "Line1";
    start(options);
    ASSERT_TRUE(frame());
    const common::UniqueFd socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    const std::vector<std::uint16_t> ports = open_ports();
    ASSERT_GE(ports.size(), 2U);
    std::mt19937 random(1);
    const std::array<std::vector<std::uint8_t>, 3> heads{
        {{}, {0, 0, 0, 1, 1, 0, 0, 0}, {0x42, 1, 0, 0xC0, 0, 16, 0, 9, 0, 0, 0x90, 0x11}}};  // none, GVSP, GVCP
    for (int k = 0; k < 3000; ++k) {
        std::vector<std::uint8_t> packet(random() % 1400);
        for (std::uint8_t& byte : packet) byte = static_cast<std::uint8_t>(random());
        const std::vector<std::uint8_t>& head = heads[random() % 3];
        std::copy_n(head.begin(), std::min(head.size(), packet.size()), packet.begin());
        sockaddr_in to{};
        to.sin_family = AF_INET;
        to.sin_port = htons(ports[random() % ports.size()]);
        to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        (void)::sendto(socket.get(), packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to),
                       sizeof to);
    }
    run_until([&] { return !ear_.losses.empty(); }, 500ms);
    ear_.frames.clear();
    sensor_->stop();
    ear_.losses.clear();
    // The camera keeps the control of a process that crashed for its heartbeat time.
    ASSERT_TRUE(run_until([&] { return sensor_->start(ear_).has_value(); }));
    EXPECT_TRUE(frame());
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
