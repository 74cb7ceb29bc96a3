#include "algo/emd/transport_simplex.h"

#include <algorithm>
#include <array>
#include <tuple>

#include <gtest/gtest.h>

#include "algo/emd/ground_distance.h"
#include "tests/algo/emd/transport_problem.h"

namespace hord::algo {
namespace {

using namespace testing;

std::vector<std::size_t> members(const std::vector<bool>& of) {
    std::vector<std::size_t> in;
    for (std::size_t k = 0; k < of.size(); ++k) {
        if (of[k]) in.push_back(k);
    }
    return in;
}

// The definition of transport_start.h: serves the open cells in order of c_ij - R_i - K_j, with 1.2 times the mean
// costs of row and column.
std::vector<TransportStep> least_reduced_costs(Problem p) {
    double total = 0;
    for (const double mass : p.supply) total += mass;
    std::vector<double> mean_row(p.supply.size()), mean_col(p.demand.size());
    for (int i = 0; i < p.rows; ++i) {
        for (int j = 0; j < p.cols; ++j) {
            mean_row[static_cast<std::size_t>(i)] += p.cost_of(i, j) * p.demand[static_cast<std::size_t>(j)] / total;
            mean_col[static_cast<std::size_t>(j)] += p.cost_of(i, j) * p.supply[static_cast<std::size_t>(i)] / total;
        }
    }
    std::vector<TransportStep> steps;
    std::vector<bool> row_open(p.supply.size(), true), col_open(p.demand.size(), true);
    for (int cols = p.cols; static_cast<int>(steps.size()) < p.rows + p.cols - 1;) {
        std::size_t row = 0, col = 0;
        for (double least = 1e9; const std::size_t i : members(row_open)) {
            for (const std::size_t j : members(col_open)) {
                const double reduced =
                    p.cost_of(static_cast<int>(i), static_cast<int>(j)) - 1.2 * (mean_row[i] + mean_col[j]);
                if (reduced < least) std::tie(least, row, col) = std::tuple(reduced, i, j);
            }
        }
        const double flow = std::min(p.supply[row], p.demand[col]);
        const bool row_used_up = p.supply[row] < p.demand[col] || cols == 1;
        steps.push_back({flow, static_cast<std::int16_t>(row), static_cast<std::int16_t>(col), row_used_up});
        p.supply[row] -= flow;
        p.demand[col] -= flow;
        (row_used_up ? row_open[row] : col_open[col]) = false;
        cols -= row_used_up ? 0 : 1;
    }
    return steps;
}

// Columns around whole vectors: up to six vectors in registers, more in memory. Rounded costs may swap two cells
// occasionally.
TEST(TransportSimplex, begins_with_the_cells_of_least_reduced_cost) {
    Random random(6);
    for (const int cols : {2, 8, 9, 16, 17, 24, 25, 32, 33, 40, 41, 48, 49, 70}) {
        for (const Isa isa : {Isa::portable, Isa::avx2, Isa::avx512}) {
            if (!has(isa)) continue;
            int found = 0, given = 0, differ = 0;
            constexpr int kProblems = 40;
            for (int n = 0; n < kProblems; ++n) {
                const int rows = pick(random, 2, cols + 3);
                Problem p(random, rows, cols);
                p.share_out(random, n % 2 == 0 ? 100000 : std::max(rows, cols) + n);  // few units make ties
                auto simplex = p.simplex(isa);
                const auto alone = simplex.solve(p.transport()),
                           from = simplex.solve(p.transport(), least_reduced_costs(p).data());
                ASSERT_TRUE(alone.proven && from.proven) << rows << "x" << cols;
                ASSERT_NEAR(alone.cost, from.cost, 1e-10 * 100000) << rows << "x" << cols;
                found += alone.pivots;
                given += from.pivots;
                differ += alone.pivots != from.pivots ? 1 : 0;
            }
            EXPECT_LE(differ, kProblems / 8)
                << cols << " columns: " << found << " pivots, " << given << " from the plain start";
        }
    }
}

// Of any two sizes, with vectors in registers and in memory; few units make ties.
TEST(TransportSimplex, solves_two_problems_with_the_bits_of_one_after_the_other) {
    Random random(7);
    constexpr int kBins = 70;
    for (int n = 0; n < 300; ++n) {
        const auto small = [&] { return pick(random, 2, n % 3 == 0 ? kBins : 30); };
        std::array<Problem, 2> p = {Problem(random, kBins, kBins), Problem(random, kBins, kBins)};
        std::array<Transport, 2> both;
        for (std::size_t k = 0; k < 2; ++k) {
            const int rows = small(), cols = small();
            Problem part(random, rows, cols);
            part.share_out(random, n % 2 == 0 ? 100000 : std::max(rows, cols) + n);
            p[k].supply = part.supply;
            p[k].demand = part.demand;
            both[k] = {rows, cols, p[k].supply.data(), p[k].demand.data(), p[k].row_bin.data(), p[k].col_bin.data()};
        }
        for (const Isa isa : {Isa::portable, Isa::avx2, Isa::avx512}) {
            if (!has(isa)) continue;
            auto simplex = p[0].simplex(isa);
            const auto together = simplex.solve_two(both);
            for (std::size_t k = 0; k < 2; ++k) {
                const auto alone = simplex.solve(both[k]);
                ASSERT_TRUE(together[k].proven) << n;
                ASSERT_EQ(together[k].cost, alone.cost) << n;
                ASSERT_EQ(together[k].pivots, alone.pivots) << n;
            }
        }
    }
}

TEST(TransportSimplex, comes_to_the_same_cost_from_any_start) {
    Random random(3);
    const std::pair<int, int> sizes[] = {{2, 2},   {5, 3},   {9, 14},  {16, 17}, {17, 17},
                                         {33, 32}, {35, 38}, {40, 45}, {40, 57}, {60, 50}};
    for (const auto& [rows, cols] : sizes) {
        for (int n = 0; n < 20; ++n) {
            Problem p(random, rows, cols);
            p.share_out(random, n % 2 == 0 ? 100000 : std::max(rows, cols) + n);  // few units make ties
            auto simplex = p.simplex();
            const auto found = simplex.solve(p.transport());
            const auto given = simplex.solve(p.transport(), staircase(p).data());
            ASSERT_TRUE(found.proven && given.proven) << rows << "x" << cols;
            ASSERT_NEAR(given.cost, found.cost, 1e-10 * 100000) << rows << "x" << cols;
        }
    }
}

// Costs along the start alternate between 1 and 0: duals grow from row to row beyond the integer range.
TEST(TransportSimplex, finds_its_way_back_from_dual_variables_out_of_range) {
    Random random(4);
    for (int side = 3; side <= 40; ++side) {
        Problem p(random, side, side);
        for (int k = 0; k < side; ++k) {
            p.cost_of(k, k) = 1;
            if (k > 0) p.cost_of(k, k - 1) = 0;
        }
        std::fill(p.supply.begin() + 1, p.supply.end(), 2);
        std::fill(p.demand.begin(), p.demand.end() - 1, 2);
        const auto steps = staircase(p);
        auto simplex = p.simplex();
        const auto found = simplex.solve(p.transport());
        const auto given = simplex.solve(p.transport(), steps.data());
        ASSERT_TRUE(found.proven && given.proven) << side;
        ASSERT_NEAR(given.cost, found.cost, 1e-9) << side;
        for (const Isa isa : {Isa::portable, Isa::avx2, Isa::avx512}) {
            if (!has(isa)) continue;
            auto other = p.simplex(isa);
            ASSERT_EQ(other.solve(p.transport(), steps.data()).cost, given.cost) << side;
            ASSERT_EQ(other.solve(p.transport()).cost, found.cost) << side;
        }
    }
}

TEST(TransportSimplex, needs_no_pivot_where_nothing_costs) {
    Random random(5);
    Problem p(random, 7, 9);
    std::fill(p.cost.begin(), p.cost.end(), 0.0);
    p.share_out(random, 50);
    const auto outcome = p.simplex().solve(p.transport());
    EXPECT_TRUE(outcome.proven);
    EXPECT_EQ(outcome.cost, 0);
    EXPECT_EQ(outcome.pivots, 0);
}

}  // namespace
}  // namespace hord::algo
