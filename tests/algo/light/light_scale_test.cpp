// What the dark level leaves of lenslets that show a share of the free light.
#include "algo/light/light_scale.h"

#include <vector>

#include <gtest/gtest.h>

namespace hord::algo {
namespace {

constexpr Extents kTwo{2, 1, 3, 3};

// Two lenslets: one dark, one with a spot of 40, 20 and 10 DN above a pedestal of 2 DN.
Frame spot_of_free_light() {
    Frame frame(6, 3, 8);
    for (int y = 0; y < 3; ++y) {
        for (int x = 0; x < 6; ++x) frame.set(x, y, 2);
    }
    frame.set(3, 1, 12), frame.set(4, 1, 42), frame.set(5, 1, 22);
    return frame;
}

TEST(LightScale, is_what_the_dark_level_leaves_of_every_bin) {
    const Frame frame = spot_of_free_light();
    const std::vector<std::uint32_t> lit = {1};
    const LightScale scale(frame.view(), kTwo, lit, 2, 6);  // 4 DN are taken: 36, 16 and 6 are left
    EXPECT_DOUBLE_EQ(scale.left(1), 1);
    EXPECT_NEAR(scale.left(0.5), (16 + 6 + 1) / 58.0, 1e-9);
    EXPECT_NEAR(scale.left(0.25), (6 + 1) / 58.0, 1e-9);
    EXPECT_EQ(scale.left(0.09), 0);
    EXPECT_EQ(scale.left(0), 0);
    for (const double share : {0.12, 0.2, 0.5, 0.77, 1.0, 1.2})
        EXPECT_NEAR(scale.share(scale.left(share)), share, 1e-9);
    EXPECT_NEAR(scale.share(0), 0.1, 1.0 / 64);  // below it nothing is left
}

// The faint bins are lost first: of half of the light 16, 6 and 1 DN are left where 36, 16 and 6 were.
TEST(LightScale, tells_how_far_the_mean_of_what_is_left_moves) {
    const Frame frame = spot_of_free_light();
    const std::vector<std::uint32_t> lit = {1};
    const LightScale scale(frame.view(), kTwo, lit, 2, 6);
    EXPECT_EQ(scale.shift(1).x, 0);
    EXPECT_NEAR(scale.shift(0.5).x, (16 + 2 * 6) / 23.0 - (36 + 2 * 16) / 58.0, 1e-9);
    EXPECT_NEAR(scale.shift(0.5).y, 0, 1e-9);
    EXPECT_NEAR(scale.shift(0).x, scale.shift(7.0 / 64).x, 1e-9);  // 6/64 of 40 DN are below 4 DN
}

TEST(LightScale, takes_nothing_where_no_free_light_is_seen) {
    const Frame frame = spot_of_free_light();
    for (const LightScale& scale : {LightScale(), LightScale(frame.view(), kTwo, {}, 2, 6)}) {
        for (const double share : {0.0, 0.3, 1.0, 1.5}) {
            EXPECT_NEAR(scale.left(share), share, 1e-12);
            EXPECT_NEAR(scale.share(share), share, 1e-12);
            EXPECT_EQ(scale.shift(share).x, 0);
        }
    }
}

}  // namespace
}  // namespace hord::algo
