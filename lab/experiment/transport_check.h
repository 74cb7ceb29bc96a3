// Two solvers of the earth mover's distance that are independent of algo/, as oracles.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/emd/ground_distance.h"

namespace hord::lab {

using Masses = std::vector<std::uint16_t>;

// The exact distance by successive shortest paths (Dijkstra with potentials over the dense bipartite graph), on whole
// histograms: nothing cancelled, nothing compressed. Masses are exact int64; costs are doubles: error below 1e-12 of
// the largest cost. Slow: for checking only. Neither histogram may be dark.
double distance_by_shortest_paths(const Masses& a, const Masses& b, const algo::GroundDistance& ground);

// Entropic optimal transport (Sinkhorn), in the log domain, so that nothing underflows. Its plan's cost is above the
// exact distance by at most epsilon * ln(rows * columns) (the entropy term), and deviates further by the error of the
// marginals:
//     exact - residual * largest <= cost <= exact + epsilon * ln(rows * columns) + residual * largest
// The answer is meaningful only if its residual is small: check it first.
struct Sinkhorn {
    double cost = 0;      // sum of plan times cost, for total mass 1
    double residual = 0;  // L1 distance of the plan's row sums from those wanted (its column sums are exact)
    double bias = 0;      // epsilon * ln(rows * columns)
    int rounds = 0;
};
Sinkhorn sinkhorn(const Masses& a, const Masses& b, const algo::GroundDistance& ground, double epsilon,
                  double wanted_residual, int most_rounds);

}  // namespace hord::lab
