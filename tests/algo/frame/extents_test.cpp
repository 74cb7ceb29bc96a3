#include "algo/frame/extents.h"

#include <gtest/gtest.h>

namespace hord::algo {
namespace {

TEST(Extents, follow_from_a_frame_and_its_bins) {
    const auto extents = extents_of_frame(999, 990, 9, 10);
    ASSERT_TRUE(extents);
    EXPECT_EQ(*extents, (Extents{111, 99, 9, 10}));
    EXPECT_EQ(extents->width_px(), 999);
    EXPECT_EQ(extents->height_px(), 990);
}

TEST(Extents, refuse_bins_that_do_not_divide_the_frame_and_name_the_numbers) {
    const auto extents = extents_of_frame(1000, 999, 9, 9);
    ASSERT_FALSE(extents);
    EXPECT_EQ(extents.error().code, ErrorCode::invalid_argument);
    EXPECT_NE(extents.error().what.find("1000x999"), std::string::npos);
    EXPECT_FALSE(extents.error().cure.empty());
}

TEST(Extents, hold_3_to_15_bins_and_3_to_2048_lenslets) {
    EXPECT_TRUE(check({3, 3, 3, 3}));
    EXPECT_TRUE(check({2048, 2048, 15, 15}));
    EXPECT_FALSE(check({2, 3, 3, 3}));
    EXPECT_FALSE(check({3, 2049, 3, 3}));
    EXPECT_FALSE(check({3, 3, 2, 3}));
    EXPECT_FALSE(check({3, 3, 3, 16}));
}

}  // namespace
}  // namespace hord::algo
