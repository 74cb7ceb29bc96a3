// How far from the learned poses good parts may lie.
#include "algo/reference/pose_tolerance.h"

#include <algorithm>
#include <cmath>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/algo/reference/good_parts.h"

namespace hord::algo {
namespace {

using namespace testing;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr double kScore = 6;

// A plate of 30x23 lenslets that is not turned, with dark bevels of 1.5.
Frame plate_at(const Pose& pose, std::uint64_t seed, double light = 1) {
    const auto covered = [](double at, double half) {
        return std::clamp(std::min(at + 0.5, half) - std::max(at - 0.5, -half), 0.0, 1.0);
    };
    const Frame clean = drawn(kPlateField, kBits, kElectrons / (1.22 * 1.22), [&](int m, int n) {
        const double x = m - 30 - pose.x, y = n - 30 - pose.y;
        return Spot{0, 0, 1 - covered(x, 15) * covered(y, 11.5) + covered(x, 13.5) * covered(y, 10)};
    });
    return seen(clean, seed, light);
}
Learned plates_within(double lenslets) {
    std::mt19937_64 random(21);
    std::uniform_real_distribution<double> shift(-lenslets, lenslets);
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 16; ++k) {
        const double x = shift(random), y = shift(random);
        frames.push_back(plate_at({x, y, 0}, k));
    }
    return learn_plates(frames).value();
}

TEST(PoseTolerance, plates_within_what_is_told_pass_and_those_twice_as_far_do_not) {
    const Learned all = plates_within(0.02);
    const auto tolerance = edge_tolerance(all.reference, kScore);
    ASSERT_TRUE(tolerance);
    Recipe with = recipe();
    with.reference = std::make_shared<Reference>(all.reference);
    std::size_t passed_within = 0, passed_beyond = 0;
    constexpr std::size_t kDirections = 8;
    for (std::uint64_t k = 0; k < kDirections; ++k) {
        const double angle = (static_cast<double>(k) + 0.3) * 2 * 3.14159265 / kDirections, x = std::cos(angle),
                     y = std::sin(angle), within = 0.8 * *tolerance, beyond = 2 * *tolerance;
        ASSERT_LT(beyond, kWorstShift);
        for (const double light : {1.0, 0.25}) {
            const auto verdict = [&](double by) {
                return judge(plate_at({by * x, by * y, 0}, 100 + k, light), with).verdict;
            };
            passed_within += verdict(within) == Verdict::pass ? 1 : 0;
            if (light == 1) passed_beyond += verdict(beyond) == Verdict::pass ? 1 : 0;
        }
        EXPECT_FALSE(moves_edges_too_far(all.reference, {0.5 * within * x, 0.5 * within * y, 0}, kScore));
        EXPECT_TRUE(moves_edges_too_far(all.reference, {beyond * x, beyond * y, 0}, kScore));
    }
    EXPECT_EQ(passed_within, 2 * kDirections);
    EXPECT_LE(passed_beyond, kDirections / 4);
}

TEST(PoseTolerance, is_told_where_the_parts_lie_alike_and_not_where_they_differ) {
    const auto told = Contains(HasSubstr("may be rejected there"));
    EXPECT_THAT(unsure_of(plates_within(0.02), "", kScore), told);
    EXPECT_THAT(unsure_of(plates_within(0.5), "", kScore), Not(told));
    EXPECT_THAT(unsure_of(learned(), "", kScore), Not(told));
}

}  // namespace
}  // namespace hord::algo
