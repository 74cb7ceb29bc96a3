// Flaws of a known place and size.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include <gtest/gtest.h>

#include "tests/algo/reference/good_parts.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

// The share of a lenslet that a disc covers.
double covered(int m, int n, double at_m, double at_n, double radius) {
    constexpr int kPoints = 16;
    int inside = 0;
    for (int k = 0; k < kPoints * kPoints; ++k) {
        const double x = m + (k % kPoints + 0.5) / kPoints - 0.5, y = n + (k / kPoints + 0.5) / kPoints - 0.5;
        inside += std::hypot(x - at_m, y - at_n) < radius ? 1 : 0;
    }
    return static_cast<double>(inside) / (kPoints * kPoints);
}

TEST(FlawSize, is_that_of_the_light_that_is_missing) {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> offset(-0.5, 0.5);
    for (const double depth : {1.0, 0.5}) {
        for (const double radius : {0.3, 0.5, 0.8, 1.2, 2.0, 3.0}) {
            if (depth * radius < 0.3) continue;
            for (std::uint64_t seed = 0; seed < 4; ++seed) {
                const double m = 22 + offset(random), n = 17 + offset(random);
                const Judged judged =
                    judge(seen(part(wobble(40 + seed),
                                    [&](int x, int y, Spot& s) { s.light *= 1 - depth * covered(x, y, m, n, radius); }),
                               seed));
                ASSERT_FALSE(judged.defects.empty()) << radius;
                const Defect& d = judged.defects[0];
                // Which opacity a disc has that covers no lenslet whole, and where in a lenslet it lies, is not known.
                const double least = radius < 1.2 ? radius * std::sqrt(depth) : radius;
                const double place = 0.15 + std::numbers::sqrt2 * std::max(0.0, 0.5 - radius);
                EXPECT_GT(d.radius, least - 0.15) << radius << " " << depth;
                EXPECT_LT(d.radius, radius + 0.15) << radius << " " << depth;
                EXPECT_LT(std::hypot(d.m - m, d.n - n), place) << radius << " " << depth;
            }
        }
    }
}

// Sizes are told only, so their time is limited: about 40 to 50 lenslets are read for a speck, and a quarter of the
// field in all.
TEST(FlawSize, is_measured_of_the_worst_flaws_until_a_quarter_of_the_field_was_read) {
    const Judged judged = judge(seen(part(wobble(60),
                                          [&](int m, int n, Spot& s) {
                                              if (m % 6 == 2 && n % 6 == 0) s.light = 0;
                                          }),
                                     6));
    ASSERT_GT(judged.defects.size(), 12U);
    const auto measured = std::ranges::count_if(judged.defects, [](const Defect& d) { return d.radius > 0; });
    EXPECT_GE(measured, 7);
    EXPECT_LE(measured, 11);
    EXPECT_EQ(judged.defects.back().radius, 0);
}

// All light of a disc goes to other bins.
TEST(FlawSize, is_that_of_the_light_that_is_bent) {
    for (const double radius : {1.2, 2.0, 3.0}) {
        const double m = 22.3, n = 16.8;
        const Frame rest = part(wobble(50), [&](int x, int y, Spot& s) { s.light *= 1 - covered(x, y, m, n, radius); });
        const Frame moved = part(wobble(50), [&](int x, int y, Spot& s) {
            s.light *= covered(x, y, m, n, radius);
            s.y += 2.5;
        });
        // `moved` holds the free light beside the part, too: only what lies near the flaw is taken from it.
        Frame frame = rest;
        for (int y = 10 * kField.j; y < 24 * kField.j; ++y) {
            for (int x = 15 * kField.i; x < 30 * kField.i; ++x)
                frame.set(x, y, rest.view().sample(x, y) + moved.view().sample(x, y));
        }
        const Judged judged = judge(seen(frame, 5));
        ASSERT_FALSE(judged.defects.empty()) << radius;
        EXPECT_NEAR(judged.defects[0].radius, radius, 0.2);
        EXPECT_NEAR(judged.defects[0].m, m, 0.2);
        EXPECT_NEAR(judged.defects[0].n, n, 0.2);
    }
}

}  // namespace
}  // namespace hord::algo
