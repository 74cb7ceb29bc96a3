// Judged against a reference, a verdict by bounds of the EMD gradient is that of the exact map.
#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "tests/algo/inspection/judged_alike.h"
#include "tests/algo/reference/good_parts.h"

namespace hord::algo {
namespace {

using namespace testing;

Frame any_part(std::uint64_t seed, std::mt19937_64& random) {
    const int kind = static_cast<int>(random() % 6), m0 = 12 + static_cast<int>(random() % 17),
              n0 = 12 + static_cast<int>(random() % 13);
    const double strength = 0.05 * static_cast<double>(random() % 21);
    const Frame frame = part(wobble(seed), [&](int m, int n, Spot& s) {
        const bool near = std::hypot(m - m0, n - n0) < 2;
        if (kind == 1 && near) s.light *= 1 - strength;
        if (kind == 2 && near) s.x += strength;
        if (kind == 3 && m == m0 && n == n0) s.y += 2 * strength;
        if (kind == 4 && std::abs(m - m0) < 1) s.x -= strength;
    });
    return seen(frame, seed, kind == 5 ? 0.5 : 1);
}

TEST(BoundedReference, verdicts_are_those_of_the_exact_map) {
    std::mt19937_64 random(61);
    std::size_t rejected = 0, passed = 0, bounds = 0, cut_short = 0;
    for (std::uint64_t seed = 0; seed < 60; ++seed) {
        SCOPED_TRACE(seed);
        Recipe with = recipe();
        with.emd_limit_bins = 0.1F * static_cast<float>(1 + random() % 15);
        with.cluster_score = random() % 3 == 0 ? 30.0F : 9.0F;
        if (random() % 4 == 0) with.reject_score = 40, with.grow_score = 20;  // the gradients decide
        with.slopes = random() % 2 == 0;
        const Frame frame = any_part(seed, random);
        auto exactly = Pipeline::create(kField, kBits, with, 1, MapSet::exact);
        auto judging = Pipeline::create(kField, kBits, with);
        ASSERT_TRUE(exactly && judging);
        const auto exact = exactly->inspect(frame.view());
        const auto found = judging->inspect(frame.view(), nullptr, kUnlimited);
        ASSERT_TRUE(exact && found);
        EXPECT_FALSE(found->bounded);
        ASSERT_NO_FATAL_FAILURE(expect_same_verdict(*found, *exact));
        ASSERT_TRUE(std::ranges::equal(found->z_score, exact->z_score));
        (exact->verdict == Verdict::pass ? passed : rejected) += 1;
        for (std::size_t k = 0; k < exact->gradient.size(); ++k)
            bounds += found->gradient[k] > exact->gradient[k] ? 1 : 0;
        for (const std::int64_t work : {0, 10'000}) {
            const auto hasty = judging->inspect(frame.view(), nullptr, {0, work, 0});
            cut_short += hasty->bounded ? 1 : 0;
            ASSERT_FALSE(hasty->verdict == Verdict::pass && exact->verdict != Verdict::pass);
            ASSERT_TRUE(hasty->bounded || hasty->score == exact->score);
            ASSERT_GE(hasty->score, exact->score);
        }
    }
    EXPECT_GT(rejected, 10U);
    EXPECT_GT(passed, 10U);
    EXPECT_GT(bounds, 60 * kField.lenslets() / 8);
    EXPECT_GT(cut_short, 10U);
}

}  // namespace
}  // namespace hord::algo
