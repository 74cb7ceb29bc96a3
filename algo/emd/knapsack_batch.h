// Batches of transport problems with at most five bins, the most common case among neighbouring lenslets
// (algo/emd/sparse_hord.h). One side has at most two bins, so that the problem is a fractional knapsack
// (algo/emd/transport_batch.h); the second row may be empty. One batch takes all shapes: a bin without mass is a column
// of mass 0, which changes no bit of any sum. Formats, ranges and bits are those of transport_batch.h.
#pragma once

#include <cstdint>

#include "algo/emd/sparse_hord.h"
#include "algo/emd/transport_batch.h"
#include "algo/simd/isa.h"

namespace hord::algo {

constexpr int kMaxKnapsackBins = 5;

// Differences with at most kMaxKnapsackBins bins. Unused lanes are zero or hold an earlier difference of the same
// ground distance, so that their bins and masses are in range; their results are ignored.
struct KnapsackBatch {
    int filled = 0;
    SparseDifference difference[kBatchLanes] = {};
};

struct KnapsackAnswer {
    double distance[kBatchLanes];
    std::uint32_t proven;  // bit l: lane l is optimal; others go to transport_batch.h: float keys of columns tied
};

using SolveKnapsackBatch = void (*)(const KnapsackBatch& batch, const TransportBatchCosts& costs,
                                    KnapsackAnswer& answer);
SolveKnapsackBatch knapsack_kernel(Isa isa);

}  // namespace hord::algo
