// Batches of small transport problems, one per lane. All problems of a batch have the same numbers of rows and columns
// and so take the same steps (docs/notes/emd.md). Where a plan is not proven optimal, `proven` is false.
//
// Formats, ranges and error bound are those of emd_solver.h: std::int32_t and doubles give the same results. The 8 low
// bits of a float key are replaced by the number of the cell. The operations on a problem and their order do not depend
// on the instruction set or on the other lanes: same bits.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "algo/simd/aligned.h"
#include "algo/simd/isa.h"

namespace hord::algo {

constexpr int kMaxBatchSide = 12;  // rows, and columns
constexpr int kBatchLanes = 16;    // problems of a batch
constexpr int kFewestLanes = 5;    // unproven plans that are solved together (algo/emd/transport_lanes.h)

// Nodes are numbered: rows from 0, columns from kFirstColumnNode; cells: row * kFirstColumnNode + column.
constexpr int kFirstColumnNode = 16;
constexpr int kBatchNodes = kFirstColumnNode + kMaxBatchSide;
constexpr int kMaxBatchCells = kMaxBatchSide * kFirstColumnNode;
constexpr int kMaxBatchSteps = 2 * kMaxBatchSide - 1;

// [0] rows, [1] columns. Masses are positive; rows and columns have the same sum. Two full cache lines for
// std::int32_t.
template <class Mass>
struct alignas(kAlignment) BatchedProblem {
    Mass mass[2][kMaxBatchSide];
    std::uint8_t bin[2][kMaxBatchSide];
    double* out;  // for the caller; not used here
};
static_assert(sizeof(BatchedProblem<std::int32_t>) == 2 * kAlignment);

template <class Mass>
struct TransportBatch {
    int rows = 0, cols = 0;  // 1 <= rows <= cols <= kMaxBatchSide
    int filled = 0;          // problems in use; unused lanes hold a copy of problem 0, and their results are ignored
    BatchedProblem<Mass> problem[kBatchLanes];
};

// One batch per shape, filled problem by problem.
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

    // The next free problem of a shape. The caller empties a full batch first (padded()).
    BatchedProblem<Mass>& add(std::size_t shape) { return batch[shape].problem[filled[shape]++]; }
    // Empties the batch of a shape: the result is valid until the next add(); its unused lanes are padded.
    TransportBatch<Mass>& padded(std::size_t shape) {
        TransportBatch<Mass>& taken = batch[shape];
        taken.filled = std::exchange(filled[shape], std::uint8_t{0});
        std::fill(taken.problem + taken.filled, taken.problem + kBatchLanes, taken.problem[0]);
        return taken;
    }

    alignas(kAlignment) std::array<std::uint8_t, kShapes> filled{};  // per batch; compact, since every pair reads it
    AlignedVector<TransportBatch<Mass>> batch;
};

template <class Mass>
struct TransportAnswer {
    double cost[kBatchLanes];  // mass times cost of the plan
    bool proven[kBatchLanes];  // the plan is optimal
    // Where it is not, the plan (TransportStep): each step uses up `child`, which exchanges `flow` with `parent`.
    std::int32_t child[kMaxBatchSteps][kBatchLanes], parent[kMaxBatchSteps][kBatchLanes];
    Mass flow[kMaxBatchSteps][kBatchLanes];
    // Costs of the cells, and duals of the nodes: a cell of the plan costs the sum of its two duals. Written only if at
    // least kFewestLanes plans are not proven.
    double cell_cost[kMaxBatchCells][kBatchLanes];
    double dual[kBatchNodes][kBatchLanes];
};

struct TransportBatchCosts {
    const double* table = nullptr;  // bins x bins
    int bins = 0;
    double tolerance = 0;  // a plan is optimal if no reduced cost is below -tolerance
};

template <class Mass>
using SolveTransportBatch = void (*)(const TransportBatch<Mass>& batch, const TransportBatchCosts& costs,
                                     TransportAnswer<Mass>& answer);
template <class Mass>
SolveTransportBatch<Mass> transport_kernel(Isa isa);

}  // namespace hord::algo
