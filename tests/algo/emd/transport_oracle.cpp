#include "tests/algo/emd/transport_oracle.h"

#include <cmath>
#include <numeric>

#include <lemon/network_simplex.h>
#include <lemon/smart_graph.h>

namespace hord::algo::testing {

double lemon_distance(const std::vector<std::uint16_t>& a, const std::vector<std::uint16_t>& b,
                      const GroundDistance& ground) {
    using Graph = lemon::SmartDigraph;
    const auto total = [](const std::vector<std::uint16_t>& h) {
        return std::accumulate(h.begin(), h.end(), std::int64_t{0});
    };
    const std::int64_t sum_a = total(a), sum_b = total(b);

    Graph graph;
    std::vector<Graph::Node> sources, sinks;
    std::vector<double> costs;  // of the arcs, in order
    for (std::size_t k = 0; k < a.size(); ++k) sources.push_back(graph.addNode());
    for (std::size_t k = 0; k < b.size(); ++k) sinks.push_back(graph.addNode());
    Graph::NodeMap<std::int64_t> supply(graph, 0);
    Graph::ArcMap<std::int64_t> cost(graph);
    // Integer costs: with doubles LEMON can cycle. The largest becomes 2^40, so that the plan is within 2^-40 of it;
    // the plan is evaluated with the true costs.
    const double scale = 0x1p40 / ground.largest();
    for (std::size_t k = 0; k < a.size(); ++k) {
        supply[sources[k]] = a[k] * sum_b;
        supply[sinks[k]] = -(b[k] * sum_a);
    }
    for (std::size_t p = 0; p < a.size(); ++p) {
        for (std::size_t q = 0; q < b.size(); ++q) {
            if (a[p] == 0 || b[q] == 0) continue;
            const double c = ground(static_cast<int>(p), static_cast<int>(q));
            cost[graph.addArc(sources[p], sinks[q])] = std::llround(c * scale);
            costs.push_back(c);
        }
    }
    lemon::NetworkSimplex<Graph, std::int64_t, std::int64_t> simplex(graph);
    simplex.supplyMap(supply).costMap(cost);
    simplex.run();
    double work = 0;
    for (std::size_t arc = 0; arc < costs.size(); ++arc) {
        work += static_cast<double>(simplex.flow(Graph::arcFromId(static_cast<int>(arc)))) * costs[arc];
    }
    return work / (static_cast<double>(sum_a) * static_cast<double>(sum_b));
}

}  // namespace hord::algo::testing
