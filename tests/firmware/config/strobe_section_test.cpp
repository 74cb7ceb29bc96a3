// The sections of light and light barrier.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/config/config.h"
#include "tests/firmware/config/parsed_config.h"

namespace hord::firmware {
namespace {

using test::parse;
using test::problems_of;
using ::testing::HasSubstr;

TEST(Config, every_collimator_has_limits_of_its_own_or_the_common_ones) {
    const auto config = parse(R"(
[strobe]
backend = "gpio"
lit = [0, 1]
min_rest_ms = 3
max_duty = 0.3
[[strobe.channel]]
chip = "soc"
line = "A"
[[strobe.channel]]
chip = "/dev/gpiochip3"
line = "4"
active_low = true
max_on_us = 400
min_rest_ms = 9
max_duty = 0.1
)");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(config->strobe.channels, 2);
    EXPECT_EQ(config->core.strobe_channels, 0b11U);
    EXPECT_EQ(config->strobe.gpio[0],
              (drivers::GpioStrobeChannel{{"soc", "A", false, {}}, {milliseconds(2), milliseconds(3), 0.3}}));
    EXPECT_EQ(
        config->strobe.gpio[1],
        (drivers::GpioStrobeChannel{{"/dev/gpiochip3", "4", true, {}}, {microseconds(400), milliseconds(9), 0.1}}));
}

TEST(Config, a_strobe_controller_has_its_address_its_outputs_and_its_trigger_lines) {
    const std::string head = "[strobe]\nbackend = \"gardasoft\"\n";
    const auto config = parse(head + R"(
host = "192.168.1.103"
delay_us = 30
lit = [1]
[[strobe.channel]]
output = 2
rated_ma = 500
brightness_percent = 150
max_ma = 800
chip = "soc"
line = "A"
[[strobe.channel]]
output = 1
rated_ma = 300
max_on_us = 400
chip = "soc"
line = "B"
)");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(config->strobe.channels, 2);
    EXPECT_EQ(config->core.strobe_channels, 0b10U);
    EXPECT_FALSE(config->strobe.simulated());
    ASSERT_TRUE(config->strobe.controller);
    const auto& [options, lines] = *config->strobe.controller;
    EXPECT_EQ(options.host, "192.168.1.103");
    EXPECT_EQ(options.port, 30313);
    EXPECT_EQ(options.delay, microseconds(30));
    EXPECT_EQ(options.pulse, config->core.strobe);
    EXPECT_EQ(options.channels[0], (drivers::GardasoftChannel{2, 500, 150, 800, {}}));
    EXPECT_EQ(options.channels[1],
              (drivers::GardasoftChannel{1, 300, 100, 0, {microseconds(400), milliseconds(5), 0.2}}));
    ASSERT_EQ(lines.size(), 2U);
    EXPECT_EQ(lines[1].line, "B");
    const auto serial = parse(head +
                              "device = \"/dev/ttyUSB1\"\ntrigger = \"command\"\n"
                              "[[strobe.channel]]\noutput = 1\nrated_ma = 500\n");
    ASSERT_TRUE(serial) << serial.error().what;
    EXPECT_EQ(serial->strobe.controller->gardasoft.device, "/dev/ttyUSB1");
    EXPECT_TRUE(serial->strobe.controller->triggers.empty());
}

TEST(Config, a_strobe_controller_that_would_hurt_a_light_or_cannot_be_found_is_refused_with_the_cure) {
    const auto wrong = [](const std::string& keys, const std::string& channel, const std::string& timing = {}) {
        return problems_of(timing + "[strobe]\nbackend = \"gardasoft\"\ntrigger = \"command\"\n" + keys +
                           "[[strobe.channel]]\n" + channel);
    };
    const std::string host = "host = \"h\"\n", good = "output = 1\nrated_ma = 500\n";
    EXPECT_THAT(wrong("", good), HasSubstr("strobe.host: is missing"));
    EXPECT_THAT(wrong(host + "device = \"/dev/ttyS0\"\n", good), HasSubstr("either strobe.host or strobe.device"));
    EXPECT_THAT(wrong(host, ""), AllOf(HasSubstr("name the controller's output"), HasSubstr("the light's label")));
    EXPECT_THAT(wrong(host, good + "brightness_percent = 200\n"), HasSubstr("1000 mA, above max_ma"));
    EXPECT_THAT(wrong(host, good + "brightness_percent = 400\nmax_ma = 2000\n"), HasSubstr("max_duty"));
    EXPECT_THAT(wrong(host, good + "[[strobe.channel]]\n" + good), HasSubstr("output of its own"));
    EXPECT_THAT(wrong(host, good + "min_rest_ms = 999.9\n"), HasSubstr("999 ms that the controller can wait"));
    EXPECT_THAT(wrong(host, good, "[timing]\nstrobe_us = 10\n"), HasSubstr("20 us to 999 ms"));
    EXPECT_THAT(wrong(host, good, "[timing]\nstrobe_us = 100.5\n"), HasSubstr("whole microseconds"));
    EXPECT_THAT(problems_of("[strobe]\nbackend = \"gardasoft\"\nhost = \"h\"\n"),
                HasSubstr("describe every collimator"));
    EXPECT_THAT(problems_of("[strobe]\nbackend = \"gardasoft\"\nhost = \"h\"\n[[strobe.channel]]\n" + good),
                HasSubstr("strobe.channel[0].chip: is missing"));
}

TEST(Config, a_light_on_the_cameras_output_is_told_to_the_camera) {
    const std::string good =
        "[timing]\nstrobe_delay_us = 0\nstrobe_us = 250\n[sensor]\nbackend = \"genicam\"\n"
        "trigger = \"software\"\n[strobe]\nbackend = \"camera\"\n";
    const auto config = parse(good + "camera_line = \"Line2\"\nmin_rest_ms = 7\n");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(config->strobe.camera_line, "Line2");
    EXPECT_FALSE(config->strobe.simulated());
    EXPECT_EQ(config->strobe.limits.min_rest, milliseconds(7));
    const auto& camera = std::get<drivers::GenicamSensorOptions>(config->sensor);
    EXPECT_EQ(camera.light_line, "Line2");
    EXPECT_EQ(camera.light_us, 250);

    EXPECT_THAT(problems_of(good), HasSubstr("name the camera's output"));
    const std::string line = "camera_line = \"Line2\"\n", camera_strobe = "[strobe]\nbackend = \"camera\"\n" + line;
    EXPECT_THAT(problems_of("[timing]\nstrobe_delay_us = 0\n" + camera_strobe), HasSubstr("sensor.trigger to"));
    EXPECT_THAT(problems_of(camera_strobe), HasSubstr("light and exposure are one"));
    EXPECT_THAT(problems_of(good + line + "channels = 2\n"), HasSubstr("a camera has one light"));
    EXPECT_THAT(problems_of(good + line + "max_on_us = 100\n"), HasSubstr("the limit protects the LED"));
    EXPECT_THAT(problems_of(good + line + "[[sensor.feature]]\nname = \"ExposureTime\"\nvalue = 100\n"),
                HasSubstr("sets the camera's ExposureTime"));
}

TEST(Config, a_light_barrier_on_the_cameras_input_is_told_to_the_camera) {
    const std::string camera = "[sensor]\nbackend = \"genicam\"\ntrigger = \"software\"\n";
    const std::string barrier = "[part_sensor]\nbackend = \"camera\"\n", line = "camera_line = \"Line1\"\n";
    const auto config = parse(camera + barrier + line + "active_low = true\n");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(std::get<CameraInput>(config->part_sensor), (CameraInput{"Line1", true}));
    EXPECT_EQ(std::get<drivers::GenicamSensorOptions>(config->sensor).barrier_line, "Line1");

    EXPECT_THAT(problems_of(camera + barrier), HasSubstr("name the camera's input"));
    for (const char* sensor :
         {"", "[sensor]\nbackend = \"v4l2\"\n", "[sensor]\nbackend = \"frames\"\nfolder = \"f\"\n"})
        EXPECT_THAT(problems_of(sensor + barrier + line),
                    HasSubstr("part_sensor.backend: needs a GenICam camera: set sensor.backend to \"genicam\""));
    EXPECT_THAT(problems_of(camera + barrier + line + "[line]\ntracking = \"encoder\"\n"), HasSubstr("has no encoder"));
    EXPECT_THAT(problems_of("[timing]\nstrobe_delay_us = 0\n" + camera + barrier + line +
                            "[strobe]\nbackend = \"camera\"\n" + line),
                HasSubstr("lines of their own"));
}

}  // namespace
}  // namespace hord::firmware
