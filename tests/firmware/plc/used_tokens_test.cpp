#include "firmware/plc/used_tokens.h"

#include <limits>
#include <random>
#include <set>

#include <gtest/gtest.h>

namespace hord::firmware {
namespace {

TEST(UsedTokens, a_counter_takes_one_range_whatever_the_order) {
    UsedTokens used;
    for (const std::uint32_t token : {5U, 7U, 6U, 4U, 8U, 5U}) used.insert(token);
    EXPECT_EQ(used.ranges(), 1U);
    for (std::uint32_t token = 0; token < 12; ++token) EXPECT_EQ(used.contains(token), token >= 4 && token <= 8);
}

TEST(UsedTokens, holds_the_largest_and_the_smallest_token_apart) {
    UsedTokens used;
    used.insert(std::numeric_limits<std::uint32_t>::max());
    used.insert(1);
    EXPECT_EQ(used.ranges(), 2U);
    used.insert(std::numeric_limits<std::uint32_t>::max() - 1);
    used.insert(2);
    EXPECT_EQ(used.ranges(), 2U);
    EXPECT_FALSE(used.contains(3));
    EXPECT_FALSE(used.contains(std::numeric_limits<std::uint32_t>::max() - 2));
}

TEST(UsedTokens, are_those_of_a_set) {
    std::mt19937 random(1);
    UsedTokens used;
    std::set<std::uint32_t> all;
    for (int k = 0; k < 2000; ++k) {
        const auto token = static_cast<std::uint32_t>(random() % 4000);
        used.insert(token);
        all.insert(token);
    }
    for (std::uint32_t token = 0; token < 4001; ++token) EXPECT_EQ(used.contains(token), all.contains(token)) << token;
}

TEST(UsedTokens, none_is_forgotten_when_there_are_too_many_and_the_closest_are_joined) {
    UsedTokens used;
    for (std::uint32_t k = 0; k < UsedTokens::kMaxRanges - 1; ++k) used.insert(1000 * k + 10);
    used.insert(1000 * 700 + 13);
    EXPECT_FALSE(used.contains(1000 * 700 + 11));
    used.insert(1000 * 800 + 500);
    EXPECT_EQ(used.ranges(), UsedTokens::kMaxRanges);
    for (std::uint32_t k = 0; k < UsedTokens::kMaxRanges - 1; ++k) EXPECT_TRUE(used.contains(1000 * k + 10));
    EXPECT_TRUE(used.contains(1000 * 700 + 11)) << "between the two closest";
    EXPECT_TRUE(used.contains(1000 * 700 + 13));
    EXPECT_FALSE(used.contains(1000 * 700 + 14));
    EXPECT_FALSE(used.contains(1000 * 800 + 499));
}

}  // namespace
}  // namespace hord::firmware
