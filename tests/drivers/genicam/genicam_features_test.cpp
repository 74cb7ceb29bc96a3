// Which camera, its features and its packets: what it has not is refused, with what it has.
#include <fstream>

#include "tests/drivers/genicam/genicam_fixture.h"

namespace hord::drivers {
namespace {

using test::FakeGige;
using testing::AllOf;
using testing::HasSubstr;

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

}  // namespace
}  // namespace hord::drivers
