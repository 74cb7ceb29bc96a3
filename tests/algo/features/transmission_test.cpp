#include "algo/features/transmission.h"

#include <algorithm>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

using Sums = std::vector<std::uint32_t>;
using Mask = std::vector<std::uint8_t>;

std::uint32_t typical(const Sums& sums, const Mask& mask) {
    Sums scratch(sums.size());
    return typical_light(sums, mask, 0.7F, scratch);
}

TEST(Transmission, is_relative_to_the_median_of_the_judged_lenslets_with_light) {
    const Sums sums = {100, 300, 200, 0, 9999, 9999, 9999, 120};
    const Mask mask = {kValid, kBorder, kValid, kDark, kSaturated, kRim, kOutside, kValid};
    EXPECT_EQ(typical({110, 150, 140, 0, 9999, 9999, 9999, 120}, mask), 120U);  // the lower middle one of four
    std::vector<float> out(8, -1);
    transmissions(sums, mask, 200, out);
    EXPECT_EQ(out, (std::vector<float>{0.5F, 1.5F, 1, 0, 0, 49.995F, 49.995F, 0.6F}));
}

TEST(Transmission, without_light_anywhere_is_zero_everywhere) {
    EXPECT_EQ(typical({0, 0}, {kDark, kDark}), 0U);
    std::vector<float> out(2, -1);
    transmissions(Sums{5, 0}, Mask{kValid, kDark}, 0, out);
    EXPECT_EQ(out, (std::vector<float>{0, 0}));
}

// A shadow over most of the part must not make the rest of it the odd one. 0.7: the limit.
TEST(Transmission, typical_is_the_light_of_the_bright_part_if_most_of_it_is_below_the_limit) {
    Sums sums(100, 100);
    const Mask mask(100, kValid);
    for (std::size_t k = 0; k < 85; ++k) sums[k] = 69;
    EXPECT_EQ(typical(sums, mask), 100U);
    for (std::size_t k = 0; k < 85; ++k) sums[k] = 71;
    EXPECT_EQ(typical(sums, mask), 71U);
}

TEST(Transmission, typical_is_not_moved_by_defects) {
    Sums sums(100, 250);
    Mask mask(100, kValid);
    for (std::size_t k = 0; k < 49; ++k) sums[k] = static_cast<std::uint32_t>(k);
    EXPECT_EQ(typical(sums, mask), 250U);
}

TEST(Transmission, stays_finite_at_the_ends_of_its_range) {
    std::vector<float> out(1);
    transmissions(Sums{(1U << 24) - 1}, Mask{kValid}, 1, out);
    EXPECT_EQ(out[0], 16777215.0F);
}

// Without a limit the typical light is the lower median.
TEST(Transmission, typical_light_is_the_median_at_any_number_and_size_of_sums) {
    std::mt19937_64 random(5);
    for (int round = 0; round < 300; ++round) {
        std::vector<std::uint32_t> sums(1 + random() % 500), scratch(sums.size());
        const std::uint32_t most = 1U << (1 + random() % 24);
        for (std::uint32_t& sum : sums) sum = static_cast<std::uint32_t>(random() % most);
        const std::vector<std::uint8_t> mask(sums.size(), kValid);
        const std::uint32_t seen = typical_light(sums, mask, 0, scratch),
                            bright = typical_light(sums, mask, 1e9F, scratch);
        std::ranges::sort(sums);
        EXPECT_EQ(seen, sums[(sums.size() - 1) / 2]) << round;
        EXPECT_EQ(bright, sums[sums.size() * 9 / 10]) << round;
    }
}

}  // namespace
}  // namespace hord::algo
