#include "algo/emd_small.h"

#include <bit>
#include <limits>

#include "algo/isa_targets.h"

namespace hord::algo {
namespace {

constexpr int kCells = kSmallSide * kSmallSide;
constexpr std::uint32_t kCellBits = kCells - 1;
constexpr int kMostSteps = 2 * kSmallSide - 1;
constexpr float kClosed = std::numeric_limits<float>::infinity();

float with_cell(float key, int cell) {
    return std::bit_cast<float>((std::bit_cast<std::uint32_t>(key) & ~kCellBits) | static_cast<std::uint32_t>(cell));
}

// Always inlined, so that it is compiled for the instruction set of its caller.
template <int Bytes, int W>
HORD_ALWAYS_INLINE void solve(SmallBatch<W>& batch, const SmallCosts& costs) {
    using Floats = Vector<float, W == 1 ? sizeof(float) : Bytes>;
    using Doubles = Vector<double, W == 1 ? sizeof(double) : Bytes>;
    constexpr int kFloats = sizeof(Floats) / sizeof(float);
    constexpr int kDoubles = sizeof(Doubles) / sizeof(double);
    const int rows = batch.rows;
    const int cols = batch.cols;
    const int steps = rows + cols - 1;

    // Costs, and their means over rows and columns, weighted with mass.
    double cost[kCells][W];
    double mean[2 * kSmallSide][W] = {};
    double total[W] = {};
    for (int i = 0; i < rows; ++i) {
        for (int l = 0; l < W; ++l) total[l] += batch.mass[i][l];
        for (int j = 0; j < cols; ++j) {
            double* c = cost[i * kSmallSide + j];
            for (int l = 0; l < W; ++l) c[l] = costs.table[batch.bin[i][l] * costs.bins + batch.bin[kSmallSide + j][l]];
            for (int l = 0; l < W; ++l) mean[i][l] += c[l] * batch.mass[kSmallSide + j][l];
            for (int l = 0; l < W; ++l) mean[kSmallSide + j][l] += c[l] * batch.mass[i][l];
        }
    }

    // The order in which cells are served.
    float key[kCells][W];
    float closed[2 * kSmallSide][W] = {};  // 0, or kClosed once a row or column is used up
    if (rows == 2) {
        for (int j = 0; j < cols; ++j) {
            for (int l = 0; l < W; ++l) key[j][l] = with_cell(static_cast<float>(cost[j][l] - cost[kSmallSide + j][l]), j);
            for (int l = 0; l < W; ++l) key[kSmallSide + j][l] = with_cell(std::numeric_limits<float>::max(), kSmallSide + j);
        }
    } else {
        for (int node = 0; node < 2 * kSmallSide; ++node) {
            for (int l = 0; l < W; ++l) mean[node][l] /= total[l];
        }
        for (int i = 0; i < rows; ++i) {
            for (int j = 0; j < cols; ++j) {
                const int cell = i * kSmallSide + j;
                for (int l = 0; l < W; ++l) {
                    key[cell][l] = with_cell(static_cast<float>(cost[cell][l] - mean[i][l] - mean[kSmallSide + j][l]), cell);
                }
            }
        }
    }

    // The plan: every step closes one row or one column, which then hangs from the other in the tree.
    double left[2 * kSmallSide][W];
    for (int i = 0; i < rows; ++i) {
        for (int l = 0; l < W; ++l) left[i][l] = batch.mass[i][l];
    }
    for (int j = kSmallSide; j < kSmallSide + cols; ++j) {
        for (int l = 0; l < W; ++l) left[j][l] = batch.mass[j][l];
    }
    double work[W] = {};
    std::uint32_t degenerate[W] = {};
    std::uint32_t served[kMostSteps][W];
    std::uint32_t child[kMostSteps][W];
    std::uint32_t parent[kMostSteps][W];
    for (int step = 0; step < steps; ++step) {
        float least[W];
        for (int l = 0; l < W; l += kFloats) {
            Floats in_all = Floats{} + kClosed;
            for (int i = 0; i < rows; ++i) {
                Floats in_row = Floats{} + kClosed;
                for (int j = 0; j < cols; ++j) {
                    in_row = lower<Floats>(in_row, load<Floats>(&key[i * kSmallSide + j][l]) + load<Floats>(&closed[kSmallSide + j][l]));
                }
                in_all = lower<Floats>(in_all, in_row + load<Floats>(&closed[i][l]));
            }
            store(in_all, &least[l]);
        }
        // No branches: they would be guesses.
        const std::uint32_t not_last = step != steps - 1 ? 1 : 0;
        for (int l = 0; l < W; ++l) {
            const auto cell = std::bit_cast<std::uint32_t>(least[l]) & kCellBits;
            const auto row = cell / kSmallSide;
            const auto col = kSmallSide + cell % kSmallSide;
            const double in_row = left[row][l];
            const double in_col = left[col][l];
            const double moved = lower(in_row, in_col);
            const std::uint32_t row_closes = in_row < in_col;
            const std::uint32_t col_closes = in_col < in_row;
            const std::uint32_t which = (row ^ col) & (0U - row_closes);
            degenerate[l] |= (row_closes ^ col_closes ^ 1U) & not_last;
            work[l] += moved * cost[cell][l];
            left[row][l] = in_row - moved;
            left[col][l] = in_col - moved;
            served[step][l] = cell;
            child[step][l] = col ^ which;
            parent[step][l] = row ^ which;
            closed[col ^ which][l] = kClosed;
        }
    }
    for (int l = 0; l < W; ++l) batch.cost[l] = work[l];
    if (rows == 2) {
        for (int l = 0; l < W; ++l) batch.proven[l] = true;
        return;
    }

    // The proof: duals from the last node to close backwards, and no cell below zero.
    double dual[2 * kSmallSide][W];
    for (int l = 0; l < W; ++l) dual[parent[steps - 1][l]][l] = 0;
    for (int step = steps - 1; step >= 0; --step) {
        for (int l = 0; l < W; ++l) dual[child[step][l]][l] = cost[served[step][l]][l] - dual[parent[step][l]][l];
    }
    double least[W];
    for (int l = 0; l < W; l += kDoubles) {
        Doubles in_all = {};
        for (int i = 0; i < rows; ++i) {
            const auto u = load<Doubles>(&dual[i][l]);
            for (int j = 0; j < cols; ++j) {
                in_all = lower<Doubles>(in_all, load<Doubles>(&cost[i * kSmallSide + j][l]) - u - load<Doubles>(&dual[kSmallSide + j][l]));
            }
        }
        store(in_all, &least[l]);
    }
    for (int l = 0; l < W; ++l) batch.proven[l] = degenerate[l] == 0 && least[l] >= -costs.tolerance;
}

HORD_FOR_EACH_ISA(solve_for, void, solve, (SmallBatch<kWide>& batch, const SmallCosts& costs), (batch, costs))

}  // namespace

void solve_small(SmallBatch<1>& batch, const SmallCosts& costs) { solve<0>(batch, costs); }

SolveWide solve_wide(Isa isa) { return solve_for(isa); }

}  // namespace hord::algo
