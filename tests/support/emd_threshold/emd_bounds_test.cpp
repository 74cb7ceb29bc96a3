#include "tests/support/emd_threshold/emd_bounds.h"

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
            bounds.set_pair(hord_of(h[n - 1]), hord_of(h[n]));
            const double exact = solver->distance(hord_of(h[n - 1]), hord_of(h[n]));
            ASSERT_LE(bounds.lower(), exact);
            ASSERT_GE(bounds.upper(EmdBounds::Order::by_lines), exact);
            ASSERT_GE(bounds.upper(EmdBounds::Order::by_columns), exact);
            ASSERT_GE(bounds.upper_by_mass(), exact);
        }
    }
}

// From (0,0) and (2,0) to (0,2) and (2,1). Line by line the first moves to (2,1) and the second to (0,2); column by
// column each stays in its column.
TEST(EmdBounds, are_those_of_plans_line_by_line_and_column_by_column) {
    Histogram a(81), b(81);
    a[0] = a[2] = 7;
    b[2 * 9 + 0] = b[1 * 9 + 2] = 7;
    const double by_lines = (std::sqrt(5.0) + std::sqrt(8.0)) / 2, by_columns = 1.5;
    EmdBounds bounds(grounds()[0]);
    bounds.set_pair(hord_of(a), hord_of(b));
    EXPECT_NEAR(bounds.upper(EmdBounds::Order::by_lines), by_lines, 1e-9);
    EXPECT_NEAR(bounds.upper(EmdBounds::Order::by_columns), by_columns, 1e-9);
    EXPECT_NEAR(bounds.upper_by_mass(), std::sqrt(128.0), 1e-9);  // nothing is shared
    EXPECT_NEAR(bounds.lower(), 1.5, 1e-9);  // the marginal along y moves by 1.5, that along x not at all
    bounds.set_pair(hord_of(a), hord_of(Histogram(81)));
    EXPECT_EQ(bounds.lower(), 0);
    EXPECT_EQ(bounds.upper_by_mass(), 0);
    EXPECT_EQ(bounds.upper(EmdBounds::Order::by_lines), 0);
}

}  // namespace
}  // namespace hord::algo
