// The section of the sensor: each camera has its own keys.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/config/config.h"
#include "tests/firmware/config/parsed_config.h"

namespace hord::firmware {
namespace {

using test::parse;
using test::problems_of;
using ::testing::HasSubstr;

TEST(Config, what_a_camera_or_its_backend_cannot_do_is_refused_by_the_check) {
    const std::string genicam = "[sensor]\nbackend = \"genicam\"\ntrigger = \"software\"\n";
    const std::pair<std::string, const char*> cases[] = {
        {genicam + "[[sensor.control]]\nname = \"Gain\"\nvalue = 1\n", "[[sensor.feature]]"},
        {genicam + "green = true\n", "only colour frames of libcamera"},
        {genicam + "device = \"/dev/video3\"\n", "name the camera in sensor.camera"},
        {"[sensor]\nbackend = \"v4l2\"\ncamera = \"A\"\n", "name the video device in sensor.device"},
        {genicam + "pixel_format = \"Mono9\"\n", "is no grey format"},
        {genicam + "pixel_format = \"Mono8\"\nbits = 12\n", "has samples of 8 bits, and sensor.bits is 12"},
        {genicam + "width_px = 1000\nheight_px = 999\n", "of 9x9 does not divide the frame"},
        {genicam + "width_px = 9\nheight_px = 999\n",
         "make a light field of 1x111 lenslets: use 3 to 2048 lenslets a side"},
        {genicam + "[[sensor.feature]]\nname = \"triggermode\"\nvalue = \"Off\"\n", "set sensor.trigger instead"},
        {genicam + "[[sensor.feature]]\nname = \"acquisitionstart\"\nvalue = true\n",
         "it sets AcquisitionStart by itself"},
        {genicam + "packet_bytes = 10\n", "is smaller than every GigE Vision camera's packets"},
        {genicam + "[[sensor.feature]]\nname = \"PixelFormat\"\nvalue = \"Mono8\"\n", "sensor.pixel_format instead"},
        {"[sensor]\nbackend = \"genicam\"\ntrigger_source = \"Software\"\n", "trigger to \"software\""},
        {"[sensor]\n[[sensor.control]]\nname = \"gain\"\nvalue = 1\n", "only cameras of v4l2 and libcamera"},
        {genicam + "[[sensor.feature]]\nname = \"TriggerMode\"\nvalue = \"Off\"\n", "set sensor.trigger instead"},
        {genicam + "[[sensor.feature]]\nname = \"AcquisitionStart\"\nvalue = true\n",
         "it sets AcquisitionStart by itself"},
        {genicam + "[[sensor.feature]]\nname = \"AcquisitionMode\"\nvalue = \"SingleFrame\"\n", "take it out"},
        {genicam + "[[sensor.feature]]\nname = \"Gain\"\nvalue = nan\n", "sensor.feature[0].value: is neither a text"},
        {genicam + "trigger_source = \"Line1\"\n", "trigger_source: has no effect with this sensor.trigger"},
        {genicam + "scenes = \"parts\"\n", "only the simulated sensor has scenes"},
    };
    for (const auto& [text, said] : cases) EXPECT_THAT(problems_of(text), HasSubstr(said)) << text;
    const std::string feature = "[[sensor.feature]]\nname = \"Gain\"\nvalue = 3\n";
    for (const char* backend : {"simulated", "frames", "v4l2", "libcamera"}) {
        const std::string text = std::string("[sensor]\nfolder = \"f\"\nbackend = \"") + backend + "\"\n";
        EXPECT_THAT(problems_of(text + feature), HasSubstr("sensor.feature: has no effect with this backend")) << text;
    }
    const std::string video = "[sensor]\nbackend = \"v4l2\"\n";
    for (const char* line : {"offset_x_px = 8", "offset_y_px = 8", "pixel_format = \"Mono8\"", "trigger = \"software\"",
                             "trigger_source = \"Line1\"", "packet_bytes = 1500", "socket_buffer_bytes = 1000000"}) {
        const std::string key = std::string(line).substr(0, std::string(line).find(' '));
        EXPECT_THAT(problems_of(video + line + "\n"), HasSubstr("sensor." + key + ": has no effect")) << line;
    }
    const std::string every_key_at_its_default = "device = \"/dev/video0\"\ngreen = false\ncamera = \"\"\n";
    EXPECT_TRUE(parse_config(genicam + every_key_at_its_default, "test.toml", {}, NamedBackends::optional));
    EXPECT_TRUE(parse_config(genicam + "width_px = 1000\nheight_px = 999\n[inspection]\ngrid = \"grid.toml\"\n",
                             "test.toml", {}, NamedBackends::optional));
}

TEST(Config, a_camera_of_libcamera_is_named_with_its_format_and_controls) {
    const auto config = parse(
        "[sensor]\nbackend = \"libcamera\"\ncamera = \"/base/imx296\"\nwidth_px = 1440\nheight_px = 1080\nbits = "
        "10\nbuffers = 6\n"
        "green = true\n[[sensor.control]]\nname = \"ExposureTime\"\nvalue = 500\n");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(std::get<drivers::LibcameraSensorOptions>(config->sensor),
              (drivers::LibcameraSensorOptions{"/base/imx296", 1440, 1080, 10, 6, true, {{"ExposureTime", 500}}}));
    EXPECT_EQ(std::get<drivers::LibcameraSensorOptions>(parse("[sensor]\nbackend = \"libcamera\"\n")->sensor),
              drivers::LibcameraSensorOptions{});
}

TEST(Config, a_genicam_camera_is_named_with_its_region_trigger_and_features_in_order) {
    const auto config = parse(
        "[sensor]\nbackend = \"genicam\"\ncamera = \"40123456\"\nwidth_px = 1440\nheight_px = 1080\noffset_x_px = "
        "8\noffset_y_px = 6\nbits = 12\npixel_format = \"Mono12p\"\nbuffers = 6\ntrigger = \"line\"\n"
        "trigger_source = \"Line2\"\npacket_bytes = 8192\nsocket_buffer_bytes = 8000000\n"
        "[[sensor.feature]]\nname = \"LineSelector\"\nvalue = \"Line2\"\n[[sensor.feature]]\nname = \"ExposureTime\"\n"
        "value = 500.5\n[[sensor.feature]]\nname = \"GainRaw\"\nvalue = 3\n[[sensor.feature]]\nname = \"ReverseX\"\n"
        "value = true\n");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(std::get<drivers::GenicamSensorOptions>(config->sensor),
              (drivers::GenicamSensorOptions{
                  .camera = "40123456",
                  .width_px = 1440,
                  .height_px = 1080,
                  .offset_x_px = 8,
                  .offset_y_px = 6,
                  .bits = 12,
                  .pixel_format = "Mono12p",
                  .buffers = 6,
                  .trigger = drivers::CameraTrigger::line,
                  .trigger_source = "Line2",
                  .packet_bytes = 8192,
                  .socket_buffer_bytes = 8'000'000,
                  .exposure_us = 500,
                  .features = {
                      {"LineSelector", "Line2"}, {"ExposureTime", "500.5"}, {"GainRaw", "3"}, {"ReverseX", "true"}}}));
    EXPECT_EQ(std::get<drivers::GenicamSensorOptions>(
                  parse("[sensor]\nbackend = \"genicam\"\ntrigger = \"software\"\n")->sensor),
              (drivers::GenicamSensorOptions{.trigger = drivers::CameraTrigger::software, .exposure_us = 500}));
    EXPECT_THAT(problems_of("[sensor]\nbackend = \"genicam\"\n"), HasSubstr("sensor.trigger_source: is missing"));
    EXPECT_THAT(problems_of("[sensor]\nbackend = \"genicam\"\ntrigger = \"free\"\n[[sensor.feature]]\nvalue = [1]\n"),
                testing::AllOf(HasSubstr("name: is missing"), HasSubstr("value: is neither a text")));
}

TEST(Config, scenes_of_the_simulated_sensor_lie_beside_the_file_and_are_no_keys_of_a_camera) {
    const auto scenes = parse("[sensor]\nbackend = \"simulated\"\nscenes = \"parts\"\n");
    ASSERT_TRUE(scenes) << scenes.error().what;
    EXPECT_EQ(std::get<SimulatedSensor>(scenes->sensor).scenes, "/etc/hord/parts");
    const auto without = parse("[sensor]\nbackend = \"simulated\"\n");
    ASSERT_TRUE(without);
    EXPECT_TRUE(std::get<SimulatedSensor>(without->sensor).scenes.empty());
}

}  // namespace
}  // namespace hord::firmware
