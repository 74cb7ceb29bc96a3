// Small transport problems, W side by side: what most pairs of neighbouring lenslets come down to.
//
// All problems of a batch have the same number of rows and columns, so that they take the same steps: lanes of a
// vector compute costs, keys and the dual check; the bookkeeping of a step is a few scalar operations a lane.
//
//   two rows    a fractional knapsack: the columns that gain most from the first row take from it until it is used up. Exact.
//   more rows   the plan that least reduced costs give (as in transport_simplex.h), and its duals; where a cell could still
//               lower the cost, or the tree is degenerate, the problem is left to the simplex: `proven` is false.
//
// Formats, ranges and error bound are those of emd.h. Keys that only choose an order are floats, whose 6 low bits are
// replaced by the cell's number. Every width W and every instruction set does the same operations in the same order
// for each problem: one result, to the last bit.
#pragma once

#include <cstdint>

#include "algo/isa.h"

namespace hord::algo {

constexpr int kSmallSide = 8;  // most rows and columns

template <int W>
struct SmallBatch {
    static constexpr int kWidth = W;
    int rows = 0, cols = 0;   // 2 <= rows <= cols <= kSmallSide
    int filled = 0;           // lanes in use
    double mass[2 * kSmallSide][W] = {};  // rows first, columns from kSmallSide on
    std::uint16_t bin[2 * kSmallSide][W] = {};
    double cost[W] = {};      // out: mass times cost of the plan
    bool proven[W] = {};      // out: it is optimal
};

struct SmallCosts {
    const double* table = nullptr;  // bins x bins
    int bins = 0;
    double tolerance = 0;           // a reduced cost below -tolerance disproves a plan
};

constexpr int kWide = 16;
void solve_small(SmallBatch<1>& batch, const SmallCosts& costs);

// The same for many, as compiled for an instruction set.
using SolveWide = void (*)(SmallBatch<kWide>& batch, const SmallCosts& costs);
SolveWide solve_wide(Isa isa);

}  // namespace hord::algo
