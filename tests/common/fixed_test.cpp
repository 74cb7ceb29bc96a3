#include "common/fixed.h"

#include <cmath>
#include <limits>
#include <random>

#include <gtest/gtest.h>

namespace hord::algo {
namespace {

using Q4_4 = Q<4, 4>;

TEST(FixedPoint, holds_what_its_format_says) {
    EXPECT_EQ(Q4_4::from_raw(24).to_double_rounded(), 1.5);
    EXPECT_EQ(Q4_4::from_raw(-1).to_double_rounded(), -0.0625);
    static_assert(std::is_same_v<Q<7, 24>::Raw, std::int32_t>);
    static_assert(std::is_same_v<Q<8, 24>::Raw, std::int64_t>);
}

TEST(FixedPoint, rounds_ratios_to_nearest_and_halves_away_from_zero) {
    EXPECT_EQ(Q4_4::from_ratio_rounded(1, 3).raw(), 5);   // 5.33
    EXPECT_EQ(Q4_4::from_ratio_rounded(2, 3).raw(), 11);  // 10.67
    EXPECT_EQ(Q4_4::from_ratio_rounded(-2, 3).raw(), -11);
    EXPECT_EQ(Q4_4::from_ratio_rounded(1, 32).raw(), 1);  // 0.5
    EXPECT_EQ(Q4_4::from_ratio_rounded(-1, 32).raw(), -1);
}

TEST(FixedPoint, halving_is_exact) {
    for (int raw = -255; raw <= 255; ++raw) {
        EXPECT_EQ(Q4_4::from_raw(raw).halved().to_double_rounded(), Q4_4::from_raw(raw).to_double_rounded() / 2);
    }
}

TEST(FixedPoint, square_roots_are_floored_exactly) {
    const auto expect_root = [](std::uint64_t value) {
        const std::uint64_t root = square_root_floored(value);
        EXPECT_LE(root * root, value);
        EXPECT_GT((root + 1) * (root + 1), value);
    };
    for (std::uint64_t value = 0; value < 2000; ++value) expect_root(value);
    for (std::uint64_t root = 1; root < (1U << 31); root = root * 3 + 1) {
        expect_root(root * root - 1);
        expect_root(root * root);
        expect_root(root * root + 1);
    }
    expect_root((std::uint64_t{1} << 62) - 1);
    std::mt19937_64 random(1);
    for (int k = 0; k < 100000; ++k) expect_root(random() >> (2 + random() % 60));
}

#ifdef HORD_CHECKED
TEST(FixedPointDeathTest, traps_overflow_in_the_checked_build) {
    EXPECT_DEATH((void)(Q4_4::from_raw(200) + Q4_4::from_raw(100)), "");
    EXPECT_DEATH((void)Q4_4::from_ratio_rounded(17, 1), "");
}
#endif

}  // namespace
}  // namespace hord::algo
