// A worse calibration does not replace a better one.
#include "calib/files/accept_calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hord::calib {
namespace {

using ::testing::HasSubstr;

GridFile good() {
    GridFile file;
    file.grid.width_px = 500;
    file.grid.height_px = 400;
    file.statistics = {.complete = 1000, .found = 1000, .blocks = 64, .cv_x_rms_px = 0.010, .cv_y_rms_px = 0.010};
    return file;
}

TEST(Better, an_equal_or_better_one_may_take_the_place) {
    GridFile fresh = good();
    EXPECT_TRUE(accept_calibration(fresh, good()));
    fresh.statistics.cv_x_rms_px = 0.0112;  // hypot(x, y) 6 % larger: within chance for 64 blocks
    EXPECT_TRUE(accept_calibration(fresh, good()));
    fresh.statistics.cv_x_rms_px = fresh.statistics.cv_y_rms_px = 0.002;
    EXPECT_TRUE(accept_calibration(fresh, good()));
}

TEST(Better, a_worse_one_may_not_and_says_why) {
    GridFile fresh = good();
    fresh.statistics.cv_x_rms_px = fresh.statistics.cv_y_rms_px = 0.013;
    const auto worse = accept_calibration(fresh, good());
    ASSERT_FALSE(worse);
    EXPECT_EQ(worse.error().code, ErrorCode::refused);
    EXPECT_THAT(worse.error().message(), HasSubstr("0.0141"));
    EXPECT_THAT(worse.error().message(), HasSubstr("0.0184"));
    fresh = good();
    fresh.statistics.found = 980;
    EXPECT_THAT(accept_calibration(fresh, good()).error().message(), HasSubstr("98.0 %"));
    fresh = good();
    fresh.grid.width_px = 501;
    EXPECT_THAT(accept_calibration(fresh, good()).error().message(), HasSubstr("501x400"));
    fresh = good();
    fresh.grid.kind = algo::LatticeKind::hexagonal;
    EXPECT_THAT(accept_calibration(fresh, good()).error().message(), HasSubstr("of a square lattice"));
}

TEST(Better, that_of_another_camera_is_not_lost_however_good_the_new_one_is) {
    GridFile held = good(), fresh = good();
    held.stamp.camera = "A 1";
    fresh.stamp.camera = "B 2";
    fresh.statistics.cv_x_rms_px = fresh.statistics.cv_y_rms_px = 0.002;
    const auto other = accept_calibration(fresh, held);
    ASSERT_FALSE(other);
    EXPECT_EQ(other.error().code, ErrorCode::refused);
    EXPECT_THAT(other.error().message(), AllOf(HasSubstr("A 1"), HasSubstr("B 2"), HasSubstr("another --out")));
    fresh.stamp.camera = kUnnamedCamera;
    EXPECT_THAT(accept_calibration(fresh, held).error().message(), AllOf(HasSubstr("A 1"), HasSubstr("--camera")));
    fresh.stamp.camera = "A 1";
    EXPECT_TRUE(accept_calibration(fresh, held));
    // A file without a name may get one.
    GridFile nameless = good();
    EXPECT_TRUE(accept_calibration(held, nameless));
    nameless.stamp.camera = kUnnamedCamera;
    EXPECT_TRUE(accept_calibration(held, nameless));
}

TEST(Better, shifts_of_single_lenslets_are_not_lost) {
    GridFile held = good();
    held.grid.columns = held.grid.rows = 1;
    held.grid.shifts_px = {{0.01, 0}};
    held.statistics.shifts = {.rms_px = 0.01, .share = 0.99, .left_x_px = 0.001, .left_y_px = 0.001};
    EXPECT_FALSE(accept_calibration(good(), held));
    EXPECT_TRUE(accept_calibration(held, good()));
}

TEST(Better, a_direction_map_is_not_lost) {
    GridFile held = good();
    held.directions.emplace();
    held.direction_statistics.captures = 12;
    held.direction_statistics.left_out_x_px = held.direction_statistics.left_out_y_px = 0.01;
    EXPECT_THAT(accept_calibration(good(), held).error().message(), HasSubstr("--tilts"));
    GridFile fresh = held;
    EXPECT_TRUE(accept_calibration(fresh, held));
    fresh.direction_statistics.left_out_x_px = 0.05;
    EXPECT_THAT(accept_calibration(fresh, held).error().message(), HasSubstr("captures"));
    EXPECT_TRUE(accept_calibration(fresh, good()));
}

}  // namespace
}  // namespace hord::calib
