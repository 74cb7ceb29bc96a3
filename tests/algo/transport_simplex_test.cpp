#include "algo/transport_simplex.h"

#include <gtest/gtest.h>

#include "histograms.h"

namespace hord::algo {
namespace {

using namespace testing;

// Rows are bins from 0, columns are the last bins.
struct Problem {
    int rows, cols, bins;
    std::vector<double> cost, supply, demand;
    std::vector<std::uint8_t> row_bin, col_bin;

    Problem(Random& random, int r, int c) : rows(r), cols(c), bins(std::max(r, c)), cost(static_cast<std::size_t>(bins * bins)) {
        std::uniform_real_distribution<double> unit(0.0, 1.0);
        for (double& value : cost) value = unit(random);
        for (int i = 0; i < rows; ++i) row_bin.push_back(static_cast<std::uint8_t>(i));
        for (int j = 0; j < cols; ++j) col_bin.push_back(static_cast<std::uint8_t>(bins - cols + j));
        supply.assign(static_cast<std::size_t>(rows), 1);
        demand.assign(static_cast<std::size_t>(cols), 1);
    }
    double& cost_of(int row, int col) { return cost[static_cast<std::size_t>(row * bins + bins - cols + col)]; }
    // Masses that add up to the same, 1 at least.
    void share_out(Random& random, int total) {
        for (int n = rows; n < total; ++n) supply[static_cast<std::size_t>(pick(random, 0, rows - 1))] += 1;
        for (int n = cols; n < total; ++n) demand[static_cast<std::size_t>(pick(random, 0, cols - 1))] += 1;
    }
    [[nodiscard]] Transport transport() const { return {rows, cols, supply.data(), demand.data(), row_bin.data(), col_bin.data()}; }
    [[nodiscard]] TransportSimplex simplex(Isa isa = best_isa()) const { return {cost.data(), bins, *std::max_element(cost.begin(), cost.end()), isa}; }
};

// From the first row and column to the last, whatever it costs.
std::vector<TransportStep> staircase(const Problem& p) {
    std::vector<TransportStep> steps;
    int i = 0, j = 0;
    for (double row = p.supply[0], col = p.demand[0]; static_cast<int>(steps.size()) < p.rows + p.cols - 1;) {
        const double flow = std::min(row, col);
        const bool row_used_up = row < col || j + 1 == p.cols;
        steps.push_back(row_used_up ? TransportStep{flow, i, p.rows + j} : TransportStep{flow, p.rows + j, i});
        row -= flow;
        col -= flow;
        if (row_used_up) {
            row = ++i < p.rows ? p.supply[static_cast<std::size_t>(i)] : 0;
        } else {
            col = p.demand[static_cast<std::size_t>(++j)];
        }
    }
    return steps;
}

TEST(TransportSimplex, comes_to_the_same_cost_from_any_start) {
    Random random(3);
    const std::pair<int, int> sizes[] = {{2, 2}, {5, 3}, {16, 17}, {17, 17}, {33, 32}, {40, 57}, {60, 50}};
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

// Costs along the start are 1 and 0 by turns: dual variables climb from row to row to many times the largest cost, out of the range of integers.
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
