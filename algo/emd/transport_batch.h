// Small transport problems, side by side: what most pairs of neighbouring lenslets come down to.
//
// All problems of a batch have the same number of rows and columns, so that they take the same steps, a lane each.
//
//   one row     all it has goes to, or comes from, the columns.
//   two rows    a fractional knapsack: the columns that gain most from the first row take from it until it is used up:
//   each what those before
//               it leave. Keys order columns roughly; where that is not enough to prove the plan, as with more rows.
//   more rows   the plan that least reduced costs give (as in transport_simplex.h), and its duals; where a cell could
//   still
//               lower the cost, `proven` is false: the simplex goes on from the steps of this plan.
//
// Formats, ranges and error bound are those of emd_solver.h. Masses are std::int32_t where those on either side add up
// to less than 2^31 (8-bit frames of 9x9 bins do), else doubles: the same integers, and the same results. Keys that
// only choose an order are floats, whose 8 low bits are replaced by the cell's number. Every instruction set does the
// same operations in the same order for each problem: one result, to the last bit, whichever problems are its
// neighbours.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "algo/simd/aligned.h"
#include "algo/simd/isa.h"

namespace hord::algo {

constexpr int kMaxBatchSide = 12;  // most rows and columns
constexpr int kWide = 16;          // problems side by side

// Nodes: rows from 0, columns from kFirstSmallColumn. A cell's number is row * kFirstSmallColumn + column.
constexpr int kFirstSmallColumn = 16;
constexpr int kSmallNodes = kFirstSmallColumn + kMaxBatchSide;
constexpr int kMaxBatchSteps = 2 * kMaxBatchSide - 1;

// Rows, then columns; masses are positive, and those of either add up to the same. Light ones take two cache lines, of
// which nothing is left over.
template <class Mass>
struct alignas(kAlignment) SmallProblem {
    Mass mass[2][kMaxBatchSide];
    std::uint8_t bin[2][kMaxBatchSide];
    double* out;  // where its answer goes; not read here
};
static_assert(sizeof(SmallProblem<std::int32_t>) == 2 * kAlignment);

// Problems of one shape.
template <class Mass>
struct TransportBatch {
    int rows = 0, cols = 0;  // 1 <= rows <= cols <= kMaxBatchSide
    int filled = 0;  // problems; those after them must be problems, too: what is computed of them is not looked at
    SmallProblem<Mass> problem[kWide];
};

// Problems that wait until there are enough of their shape.
template <class Mass>
struct TransportBatches {
    TransportBatches() : batch(kShapes) {
        for (int rows = 1; rows <= kMaxBatchSide; ++rows) {
            for (int cols = rows; cols <= kMaxBatchSide; ++cols) {
                batch[shape(rows, cols)].rows = rows;
                batch[shape(rows, cols)].cols = cols;
            }
        }
    }
    static constexpr std::size_t kShapes = (kMaxBatchSide + 1) * (kMaxBatchSide + 1);
    static std::size_t shape(int rows, int cols) { return static_cast<std::size_t>(rows * (kMaxBatchSide + 1) + cols); }

    // One more of a shape; a batch that is full is taken before the next.
    SmallProblem<Mass>& add(std::size_t shape) { return batch[shape].problem[filled[shape]++]; }
    // That of a shape, as it is solved: once more the first problem, where there is no other.
    TransportBatch<Mass>& take(std::size_t shape) {
        TransportBatch<Mass>& taken = batch[shape];
        taken.filled = std::exchange(filled[shape], std::uint8_t{0});
        std::fill(taken.problem + taken.filled, taken.problem + kWide, taken.problem[0]);
        return taken;
    }

    alignas(kAlignment)
        std::array<std::uint8_t, kShapes> filled{};  // of each batch: three cache lines, which every pair needs
    AlignedVector<TransportBatch<Mass>> batch;
};

template <class Mass>
struct TransportAnswer {
    double cost[kWide];  // mass times cost of the plan
    bool proven[kWide];  // it is optimal
    // Where it is not: the plan, a step a row or column that is used up, the child (TransportStep).
    std::int32_t child[kMaxBatchSteps][kWide], parent[kMaxBatchSteps][kWide];
    Mass flow[kMaxBatchSteps][kWide];
};

struct TransportBatchCosts {
    const double* table = nullptr;  // bins x bins
    int bins = 0;
    double tolerance = 0;  // a reduced cost below -tolerance disproves a plan
};

template <class Mass>
using SolveSmall = void (*)(const TransportBatch<Mass>& batch, const TransportBatchCosts& costs,
                            TransportAnswer<Mass>& answer);
template <class Mass>
SolveSmall<Mass> transport_kernel(Isa isa);

}  // namespace hord::algo
