// libcamera's cameras: choice of camera and format, and the request to hord-camera.
#include "drivers/libcamera/libcamera_sensor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "drivers/libcamera/libcamera_format.h"
#include "drivers/libcamera/libcamera_request.h"

namespace hord::drivers {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using Names = std::vector<std::string>;

TEST(CameraFormat, is_grey_of_the_bits_asked_for_and_unpacked_where_there_is_a_choice) {
    const Names there{"BGR888", "R10_CSI2P", "R10", "R8", "R12_CSI2P"};
    EXPECT_EQ(choose_libcamera_format("cam", there, 8)->name, "R8");
    const auto ten = choose_libcamera_format("cam", there, 10);
    EXPECT_EQ(ten->name, "R10");
    EXPECT_EQ(ten->layout, SampleLayout::plain);
    const auto twelve = choose_libcamera_format("cam", there, 12);
    EXPECT_EQ(twelve->name, "R12_CSI2P");
    EXPECT_EQ(twelve->layout, SampleLayout::mipi);
}

TEST(CameraFormat, that_is_not_there_is_refused_with_the_list_of_what_there_is) {
    const auto colour = choose_libcamera_format("imx000", Names{"BGR888", "SRGGB10"}, 10);
    ASSERT_FALSE(colour);
    EXPECT_EQ(colour.error().code, ErrorCode::unsupported);
    EXPECT_THAT(colour.error().message(),
                AllOf(HasSubstr("imx000"), HasSubstr("R10 or R10_CSI2P"), HasSubstr("BGR888, SRGGB10"),
                      HasSubstr("sensor.bits")));
    EXPECT_THAT(choose_libcamera_format("cam", Names{}, 8).error().what, HasSubstr("it has none"));
    EXPECT_THAT(choose_libcamera_format("cam", Names{"R8"}, 9).error().cure, HasSubstr("8, 10, 12 or 16"));
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
    EXPECT_FALSE(choose_libcamera_format("cam", colour, 8));
    const auto green = choose_libcamera_format("cam", colour, 8, true);
    ASSERT_TRUE(green);
    EXPECT_EQ(green->name, "BGR888");
    EXPECT_EQ(green->layout, SampleLayout::green);
    EXPECT_FALSE(choose_libcamera_format("cam", colour, 10, true));
    EXPECT_EQ(choose_libcamera_format("cam", Names{"BGR888", "R8"}, 8, true)->layout, SampleLayout::plain);
    EXPECT_THAT(choose_libcamera_format("cam", Names{"XRGB8888"}, 8, true).error().what,
                HasSubstr("R8 or BGR888 or RGB888"));
}

// With the real libcamera; no machine has a camera of this name.
TEST(Libcamera, that_lacks_the_camera_says_so) {
    auto loop = std::move(*firmware::SdEventLoop::open());
    const auto absent = open_libcamera_sensor(*loop, {.camera = "no-such-camera"});
    ASSERT_FALSE(absent);
    EXPECT_EQ(absent.error().code, ErrorCode::not_found);
    EXPECT_THAT(absent.error().what, AllOf(HasSubstr("\"no-such-camera\""), HasSubstr("cameras: ")));
    EXPECT_FALSE(libcamera_version().empty());
}

TEST(LibcameraRequest, comes_back_unchanged_and_a_malformed_one_is_none) {
    const LibcameraSensorOptions asked{.camera = "\\_SB_.PCI0 1:2.0",
                                       .width_px = 320,
                                       .height_px = 240,
                                       .bits = 12,
                                       .buffers = 5,
                                       .green = true,
                                       .controls = {{"AnalogueGain", -2}, {"ExposureTime", 600000}}};
    EXPECT_EQ(parse_libcamera_request(request_of(asked)), asked);
    for (const std::string& wrong : {std::string(), std::string("{}"), request_of(asked).substr(1)})
        EXPECT_FALSE(parse_libcamera_request(wrong));
}

}  // namespace
}  // namespace hord::drivers
