// Tests without a video device; tests/system/contract runs with one.
#include "drivers/v4l2/v4l2_sensor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/hal/packed_samples.h"
#include "lab/virtual_time/virtual_time.h"

namespace hord::drivers {
namespace {

using testing::HasSubstr;

TEST(V4l2, a_device_that_is_not_there_is_named) {
    lab::VirtualTime loop;
    V4l2SensorOptions options;
    options.device = "/dev/video-that-is-not-there";
    const auto sensor = V4l2Sensor::open(loop, options);
    ASSERT_FALSE(sensor);
    EXPECT_EQ(sensor.error().code, ErrorCode::not_found);
    EXPECT_THAT(sensor.error().what, HasSubstr("/dev/video-that-is-not-there"));
    EXPECT_FALSE(sensor.error().cure.empty());
}

TEST(V4l2, a_node_that_is_no_video_device_is_refused) {
    lab::VirtualTime loop;
    V4l2SensorOptions options;
    options.device = "/dev/null";
    const auto sensor = V4l2Sensor::open(loop, options);
    ASSERT_FALSE(sensor);
    EXPECT_EQ(sensor.error().code, ErrorCode::unsupported);
}

TEST(V4l2, an_impossible_number_of_buffers_is_refused) {
    lab::VirtualTime loop;
    V4l2SensorOptions options;
    options.buffers = 1;
    EXPECT_EQ(V4l2Sensor::open(loop, options).error().code, ErrorCode::invalid_argument);
}

std::vector<std::byte> bytes(std::initializer_list<int> values) {
    std::vector<std::byte> out;
    for (const int value : values) out.push_back(static_cast<std::byte>(value));
    return out;
}

TEST(PackedSamples, ten_bits_have_their_low_two_in_every_fifth_byte) {
    std::vector<std::uint16_t> samples(6);
    // 0x3FF, 0x000, 0x155, 0x2AA; then 0x001, 0x200 in a group that is half full.
    unpack<10>(bytes({0xFF, 0x00, 0x55, 0xAA, 0b10'01'00'11, 0x00, 0x80, 0x00, 0x00, 0b00'00'00'01}), samples);
    EXPECT_THAT(samples, testing::ElementsAre(0x3FF, 0x000, 0x155, 0x2AA, 0x001, 0x200));
    EXPECT_EQ(packed_row_bytes(10, 6), 10U);
    EXPECT_EQ(packed_row_bytes(10, 8), 10U);
}

TEST(PackedSamples, twelve_bits_have_their_low_four_in_every_third_byte) {
    std::vector<std::uint16_t> samples(3);
    unpack<12>(bytes({0xFF, 0x12, 0x3F, 0xAB, 0x00, 0x0C}), samples);
    EXPECT_THAT(samples, testing::ElementsAre(0xFFF, 0x123, 0xABC));
    EXPECT_EQ(packed_row_bytes(12, 3), 6U);
    EXPECT_EQ(packed_row_bytes(12, 4), 6U);
}

}  // namespace
}  // namespace hord::drivers
