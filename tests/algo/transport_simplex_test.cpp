#include "algo/transport_simplex.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <gtest/gtest.h>

#include "algo/ground.h"
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
    std::int16_t i = 0, j = 0;
    for (double row = p.supply[0], col = p.demand[0]; static_cast<int>(steps.size()) < p.rows + p.cols - 1;) {
        const double flow = std::min(row, col);
        const bool row_used_up = row < col || j + 1 == p.cols;
        steps.push_back({flow, i, j, row_used_up});
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

// One after the other or side by side, a plan begins with the same steps: it takes as many pivots to the same bits. Costs are those between bins.
TEST(TransportSimplex, begins_with_the_same_steps_side_by_side) {
    Random random(6);
    const auto ground = *GroundDistance::between_bins(15, 15);
    const std::pair<int, int> shapes[] = {{2, 13}, {7, 13}, {13, 13}, {8, 16}, {16, 17}, {17, 24}, {24, 24}, {3, 24}, {5, 2}, {23, 9}};
    for (const auto& [rows, cols] : shapes) {
        for (const int most : {3, 100000, 1 << 30}) {  // few units make ties
            TransportBatch batch;
            batch.rows = rows;
            batch.cols = cols;
            batch.filled = pick(random, 1, kMostStarts);
            for (auto& problem : batch.problem) {
                std::vector<std::uint8_t> bins(225);
                std::iota(bins.begin(), bins.end(), std::uint8_t{0});
                std::shuffle(bins.begin(), bins.end(), random);
                std::copy_n(bins.begin(), rows, problem.rows.bin.begin());
                std::copy_n(bins.begin() + rows, cols, problem.cols.bin.begin());
                double total = 0;
                for (int i = 0; i < rows; ++i) total += problem.rows.mass[static_cast<std::size_t>(i)] = pick(random, 1, most) + cols;
                for (int j = 0; j < cols; ++j) {
                    const double rest = total - (cols - 1 - j);
                    problem.cols.mass[static_cast<std::size_t>(j)] = j + 1 == cols ? rest : std::floor(1 + (rest - 1) * 2 * pick(random, 0, 1000) / (1000.0 * cols));
                    total -= problem.cols.mass[static_cast<std::size_t>(j)];
                }
                ASSERT_EQ(total, 0);
            }
            for (const Isa isa : {Isa::portable, Isa::avx2, Isa::avx512}) {
                if (!has(isa)) continue;
                TransportSimplex simplex(ground.row(0), ground.bins(), ground.largest(), isa);
                TransportStarts starts;
                simplex.find_starts(batch, starts);
                for (int k = 0; k < batch.filled; ++k) {
                    const auto& problem = batch.problem[static_cast<std::size_t>(k)];
                    const Transport transport{rows, cols, problem.rows.mass.data(), problem.cols.mass.data(), problem.rows.bin.data(), problem.cols.bin.data()};
                    const auto alone = simplex.solve(transport), beside = simplex.solve(transport, starts[static_cast<std::size_t>(k)].data());
                    ASSERT_TRUE(alone.proven) << rows << "x" << cols;
                    ASSERT_EQ(beside.pivots, alone.pivots) << rows << "x" << cols << ", " << k;
                    ASSERT_EQ(beside.cost, alone.cost) << rows << "x" << cols << ", " << k;
                }
            }
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
