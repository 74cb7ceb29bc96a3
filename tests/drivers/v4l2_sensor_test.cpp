// What can be told without a video device; with one, tests/contract runs.
#include "drivers/v4l2_sensor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "hal_sim/cell/virtual_time.h"

namespace hord::drivers {
namespace {

using testing::HasSubstr;

TEST(V4l2, a_device_that_is_not_there_is_named) {
    sim::VirtualTime loop;
    V4l2SensorOptions options;
    options.device = "/dev/video-that-is-not-there";
    const auto sensor = V4l2Sensor::open(loop, options);
    ASSERT_FALSE(sensor);
    EXPECT_EQ(sensor.error().code, ErrorCode::not_found);
    EXPECT_THAT(sensor.error().what, HasSubstr("/dev/video-that-is-not-there"));
    EXPECT_FALSE(sensor.error().cure.empty());
}

TEST(V4l2, a_node_that_is_no_video_device_is_refused) {
    sim::VirtualTime loop;
    V4l2SensorOptions options;
    options.device = "/dev/null";
    const auto sensor = V4l2Sensor::open(loop, options);
    ASSERT_FALSE(sensor);
    EXPECT_EQ(sensor.error().code, ErrorCode::unsupported);
}

TEST(V4l2, an_impossible_number_of_buffers_is_refused) {
    sim::VirtualTime loop;
    V4l2SensorOptions options;
    options.buffers = 1;
    EXPECT_EQ(V4l2Sensor::open(loop, options).error().code, ErrorCode::invalid_argument);
}

}  // namespace
}  // namespace hord::drivers
