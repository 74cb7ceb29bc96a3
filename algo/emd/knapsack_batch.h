// Transport problems of at most five bins, side by side: what a lens's neighbours mostly come down to
// (algo/emd/sparse_hord.h).
//
// One of the two sides has at most two bins, so that the problem is a fractional knapsack (algo/emd/transport_batch.h),
// whose other row may be empty. Shapes need not be told apart: a bin without mass is a column that takes nothing, and
// changes no bit of any sum. Formats, ranges and bits are those of transport_batch.h.
#pragma once

#include <cstdint>

#include "algo/emd/sparse_hord.h"
#include "algo/emd/transport_batch.h"
#include "algo/simd/isa.h"

namespace hord::algo {

constexpr int kMaxKnapsackBins = 5;

// Of each difference the first five bins count; of those filled the others are 0. Idle ones are as they were made, or
// hold an earlier difference of the same ground: so their bins are in the table of costs, and their masses in range;
// what comes out of them is not looked at.
struct KnapsackBatch {
    int filled = 0;
    ClosedDifference difference[kWide] = {};
};

struct KnapsackAnswer {
    double distance[kWide];
    std::uint32_t proven;  // a bit a problem; what is not proven must be solved otherwise: keys had too few bits to
                           // tell two columns apart
};

using SolveFew = void (*)(const KnapsackBatch& batch, const TransportBatchCosts& costs, KnapsackAnswer& answer);
SolveFew knapsack_kernel(Isa isa);

}  // namespace hord::algo
