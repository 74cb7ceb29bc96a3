// Transport problems and plans for tests.
#pragma once

#include <algorithm>
#include <vector>

#include "algo/emd/transport_simplex.h"
#include "tests/support/histograms.h"

namespace hord::algo::testing {

// Rows are bins from 0, columns are the last bins.
struct Problem {
    int rows, cols, bins;
    std::vector<double> cost, supply, demand;
    std::vector<std::uint8_t> row_bin, col_bin;

    Problem(Random& random, int r, int c)
        : rows(r), cols(c), bins(std::max(r, c)), cost(static_cast<std::size_t>(bins * bins)) {
        std::uniform_real_distribution<double> unit(0.0, 1.0);
        for (double& value : cost) value = unit(random);
        for (int i = 0; i < rows; ++i) row_bin.push_back(static_cast<std::uint8_t>(i));
        for (int j = 0; j < cols; ++j) col_bin.push_back(static_cast<std::uint8_t>(bins - cols + j));
        supply.assign(static_cast<std::size_t>(rows), 1);
        demand.assign(static_cast<std::size_t>(cols), 1);
    }
    double& cost_of(int row, int col) { return cost[static_cast<std::size_t>(row * bins + bins - cols + col)]; }
    [[nodiscard]] double largest_cost() const { return *std::max_element(cost.begin(), cost.end()); }
    // Masses of at least 1, with the same sum on both sides.
    void share_out(Random& random, int total) {
        for (int n = rows; n < total; ++n) supply[static_cast<std::size_t>(pick(random, 0, rows - 1))] += 1;
        for (int n = cols; n < total; ++n) demand[static_cast<std::size_t>(pick(random, 0, cols - 1))] += 1;
    }
    [[nodiscard]] Transport transport() const {
        return {rows, cols, supply.data(), demand.data(), row_bin.data(), col_bin.data()};
    }
    [[nodiscard]] TransportSimplex simplex(Isa isa = best_isa()) const {
        return {cost.data(), bins, largest_cost(), isa};
    }
};

// The north-west corner plan.
inline std::vector<TransportStep> staircase(const Problem& p) {
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

}  // namespace hord::algo::testing
