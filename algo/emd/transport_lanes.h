// Pivots for the unproven plans of a batch (algo/emd/transport_batch.h), sixteen problems at once.
//
// The steps are those of transport_simplex.h: the same cells enter, the same arcs leave, so that costs have the same
// bits. A lane that may leave the range of integer duals, or whose optimum double precision does not prove, stays
// unsolved: the simplex solves it from the same plan.
#pragma once

#include <cstdint>

#include "algo/emd/transport_batch.h"
#include "algo/simd/isa.h"

namespace hord::algo {

struct LaneOutcome {
    std::uint32_t solved;      // bits of lanes; the values of other lanes are undefined
    double cost[kBatchLanes];  // sum of mass times cost over the plan
    std::int32_t pivots[kBatchLanes];
};

// Solves the problems in the lanes whose bits are set in `lanes`; 2 <= rows <= cols <= kMaxBatchSide. `answer`: with at
// least kFewestLanes unproven plans, so that it has costs and duals. An integer cost is a double cost times `scale`.
// `tolerance`: as in TransportBatchCosts.
template <class Mass>
using PivotLanes = void (*)(const TransportAnswer<Mass>& answer, int rows, int cols, std::uint32_t lanes, double scale,
                            double tolerance, LaneOutcome& outcome);
template <class Mass>
PivotLanes<Mass> lanes_kernel(Isa isa);

}  // namespace hord::algo
