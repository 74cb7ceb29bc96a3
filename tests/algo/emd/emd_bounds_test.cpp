#include "algo/emd/emd_bounds.h"

#include <cmath>

#include <gtest/gtest.h>

#include "tests/support/histograms.h"

namespace hord::algo {
namespace {

using namespace testing;

std::vector<GroundDistance> grounds() {
    return {*GroundDistance::between_bins(9, 9), *GroundDistance::between_bins(9, 9, GroundNorm::manhattan),
            *GroundDistance::between_bins(9, 9, GroundNorm::squared_euclidean),
            *GroundDistance::between_bins(9, 9, GroundNorm::euclidean, 2.0)};
}

Histogram any(Random& random, int n) {
    return n % 4 == 0 ? scattered(random, 81, 1 + n % 50, 255)
        : n % 4 == 1  ? two_lobes(random, 9, 9, 4095)
        : n % 4 == 2  ? scattered(random, 81, 5, 2)
                      : blob(random, 9, 9, 255, 0.6);
}

std::vector<Histogram> many(int count) {
    Random random(37);
    std::vector<Histogram> all;
    for (int n = 0; n < count; ++n) all.push_back(any(random, n));
    return all;
}

TEST(EmdBounds, hold_what_the_solver_returns) {
    const auto h = many(4000);
    for (const auto& ground : grounds()) {
        EmdBounds bounds(ground);
        auto solver = EmdSolver::create(ground);
        for (std::size_t n = 1; n < h.size(); ++n) {
            const Bracket bracket = bounds(hord_of(h[n - 1]), hord_of(h[n]));
            const double exact = solver->distance(hord_of(h[n - 1]), hord_of(h[n]));
            ASSERT_LE(bracket.lower, exact);
            ASSERT_GE(bracket.upper, exact);
            ASSERT_GE(bounds.upper_by_mass(), exact);
        }
    }
}

// From (0,0) and (2,0) to (0,2) and (2,1). Line by line the first goes to (2,1), the second to (0,2); column by column
// each stays in its own.
TEST(EmdBounds, are_those_of_plans_line_by_line_and_column_by_column) {
    Histogram a(81), b(81);
    a[0] = a[2] = 7;
    b[2 * 9 + 0] = b[1 * 9 + 2] = 7;
    const double by_lines = (std::sqrt(5.0) + std::sqrt(8.0)) / 2, by_columns = 1.5;
    EmdBounds bounds(grounds()[0]);
    bounds.take(hord_of(a), hord_of(b));
    EXPECT_NEAR(bounds.upper(EmdBounds::Order::by_lines), by_lines, 1e-9);
    EXPECT_NEAR(bounds.upper(EmdBounds::Order::by_columns), by_columns, 1e-9);
    EXPECT_NEAR(bounds.upper_by_mass(), std::sqrt(128.0), 1e-9);  // nothing is shared
    EXPECT_NEAR(bounds.lower(), 1.5, 1e-9);  // the marginal along y moves by 1.5, that along x not at all
    EXPECT_NEAR(bounds(hord_of(a), hord_of(b)).upper, by_columns, 1e-9);
    bounds.take(hord_of(a), hord_of(Histogram(81)));
    EXPECT_EQ(bounds.lower(), 0);
    EXPECT_EQ(bounds.upper_by_mass(), 0);
    EXPECT_EQ(bounds.upper(EmdBounds::Order::by_lines), 0);
}

// Limits are drawn near the distance itself, where a wrong bound would show, and exactly at it. With HORD_LONG_TESTS in
// the environment: two million decisions.
TEST(EmdDecider, decides_as_the_exact_distance_does) {
    const bool is_long = std::getenv("HORD_LONG_TESTS") != nullptr;
    const auto h = many(is_long ? 125'000 : 4000);
    Random random(41);
    std::uniform_real_distribution<double> around(0.7, 1.3);
    for (const auto& ground : grounds()) {
        auto decider = EmdDecider::create(ground);
        auto solver = EmdSolver::create(ground);
        for (std::size_t n = 1; n < h.size(); ++n) {
            const Hord a = hord_of(h[n - 1]), b = hord_of(h[n]);
            const double exact = solver->distance(a, b);
            for (const double limit : {exact, exact * around(random), exact * around(random), 1.0}) {
                ASSERT_EQ(decider->exceeds(a, b, limit), exact > limit);
            }
        }
    }
}

TEST(EmdDecider, decides_gradients_as_the_exact_norm_does_and_solves_few) {
    const auto h = many(4000);
    auto ground = grounds()[0];
    auto decider = EmdDecider::create(ground);
    auto solver = EmdSolver::create(ground);
    std::uint64_t decided = 0;
    for (std::size_t n = 3; n < h.size(); ++n) {
        const Hord p[4] = {hord_of(h[n - 3]), hord_of(h[n - 2]), hord_of(h[n - 1]), hord_of(h[n])};
        const double x = solver->distance(p[0], p[1]), y = solver->distance(p[2], p[3]);
        const double exact = std::sqrt(x * x + y * y);
        for (const double limit : {0.5, 2.0, 8.0, exact}) {
            ASSERT_EQ(decider->gradient_exceeds(p[0], p[1], p[2], p[3], limit), exact > limit);
            decided += 2;
        }
    }
    EXPECT_LT(decider->solved(), decided / 2);
}

TEST(AnytimeEmd, brackets_everything_at_once_and_solves_the_widest_first_until_the_deadline) {
    const auto h = many(400);
    const auto ground = grounds()[0];
    auto solver = EmdSolver::create(ground);
    auto anytime = AnytimeEmd::create(ground, h.size() - 1);
    std::vector<double> exact;
    for (std::size_t n = 1; n < h.size(); ++n) {
        ASSERT_TRUE(anytime->add(hord_of(h[n - 1]), hord_of(h[n])));
        exact.push_back(solver->distance(hord_of(h[n - 1]), hord_of(h[n])));
    }
    EXPECT_FALSE(anytime->add(hord_of(h[0]), hord_of(h[1])));  // no room

    std::int64_t time = 0;
    const auto clock = [&] { return time++; };
    std::size_t open = exact.size() + 1;
    double widest_left = INFINITY;
    for (const std::int64_t deadline : {0, 50, 150, 100'000}) {
        time = deadline == 0 ? 0 : time;
        const std::size_t now_open = anytime->refine(clock, deadline);
        EXPECT_LT(now_open, open);
        open = now_open;
        double widest = 0;
        for (std::size_t n = 0; n < exact.size(); ++n) {
            const Bracket& bracket = anytime->brackets()[n];
            ASSERT_LE(bracket.lower, exact[n]);
            ASSERT_GE(bracket.upper, exact[n]);
            widest = std::max(widest, bracket.width());
        }
        EXPECT_LE(widest, widest_left);
        widest_left = widest;
    }
    EXPECT_EQ(open, 0U);
    for (std::size_t n = 0; n < exact.size(); ++n)
        EXPECT_EQ(anytime->brackets()[n].upper, anytime->brackets()[n].lower);

    anytime->clear();
    EXPECT_TRUE(anytime->brackets().empty());
}

}  // namespace
}  // namespace hord::algo
