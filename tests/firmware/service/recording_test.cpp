// Limits of what waits in memory for the disk.
#include <gtest/gtest.h>

#include "firmware/config/config.h"
#include "firmware/store/recorder/store_setup.h"

namespace hord::firmware {
namespace {

TEST(Recording, large_frames_wait_for_the_disk_in_256_MB_and_those_around_a_reject_find_room) {
    StoreConfig config;
    config.frame_buffers = 24;
    config.frames_before = 2;
    EXPECT_EQ(frame_buffers(config, {111, 111, 9, 9}, 8), 24U);  // 1 MB each
    EXPECT_EQ(frame_buffers(config, {555, 555, 9, 9}, 8), 10U);  // 25 MB each
    EXPECT_EQ(frame_buffers(config, {555, 555, 9, 9}, 12), 5U);  // 50 MB each
    EXPECT_EQ(frame_buffers(config, {2048, 2048, 9, 9}, 8), 4U);
    config.frame_buffers = 3;
    EXPECT_EQ(frame_buffers(config, {555, 555, 9, 9}, 8), 3U);
}

}  // namespace
}  // namespace hord::firmware
