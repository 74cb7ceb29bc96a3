#include "firmware/station/line_occupancy_marker.h"

#include <gtest/gtest.h>
#include <unistd.h>

namespace hord::firmware {
namespace {

TEST(OccupancyMarker, stays_until_a_process_ends_in_order) {
    const auto folder = std::filesystem::temp_directory_path() / ("hord-line-mark-" + std::to_string(getpid()));
    std::filesystem::create_directories(folder);
    {
        const OccupancyMarker first(folder);
        EXPECT_FALSE(first.left_behind());
        first.raise();
    }
    const OccupancyMarker next(folder);  // the first ended without clear()
    EXPECT_TRUE(next.left_behind());
    next.raise();
    next.clear();
    EXPECT_FALSE(OccupancyMarker(folder).left_behind());
    std::filesystem::remove_all(folder);
}

TEST(OccupancyMarker, without_a_folder_nothing_is_left_behind) {
    const OccupancyMarker mark{{}};
    mark.raise();
    EXPECT_FALSE(mark.left_behind());
    mark.clear();
}

}  // namespace
}  // namespace hord::firmware
