#include "tests/bench/peers.h"

#include <algorithm>
#include <cmath>

#include <lemon/network_simplex.h>
#include <lemon/smart_graph.h>
#include <opencv2/imgproc.hpp>

namespace hord::bench {
namespace {

constexpr double kCostScale = 0x1p32;

}  // namespace

CvPeer::CvPeer(const algo::GroundDistance& ground, bool cancel) : ground_(ground), cancel_(cancel) {
    for (auto& signature : signature_) signature.reserve(static_cast<std::size_t>(3 * ground.bins()));
}

double CvPeer::distance(const algo::Hord& a, const algo::Hord& b) {
    const double scale = 1.0 / (static_cast<double>(a.sum) * static_cast<double>(b.sum));
    signature_[0].clear();
    signature_[1].clear();
    const auto add = [&](int side, int k, std::int64_t mass) {
        const auto& at = ground_.directions()[static_cast<std::size_t>(k)];
        signature_[side].insert(signature_[side].end(),
                                {static_cast<float>(static_cast<double>(mass) * scale), static_cast<float>(at.x),
                                 static_cast<float>(at.y)});
    };
    std::int64_t moved = 0;
    for (int k = 0; k < ground_.bins(); ++k) {
        const std::int64_t from = static_cast<std::int64_t>(a.mass[k]) * b.sum;
        const std::int64_t to = static_cast<std::int64_t>(b.mass[k]) * a.sum;
        const std::int64_t shared = cancel_ ? std::min(from, to) : 0;
        if (from > shared) add(0, k, from - shared);
        if (to > shared) add(1, k, to - shared);
        moved += from - shared;
    }
    if (signature_[0].empty() || signature_[1].empty()) return 0;
    const auto mat = [](std::vector<float>& s) { return cv::Mat(static_cast<int>(s.size() / 3), 3, CV_32F, s.data()); };
    return static_cast<double>(cv::EMD(mat(signature_[0]), mat(signature_[1]), cv::DIST_L2)) *
        static_cast<double>(moved) * scale;
}

LemonPeer::LemonPeer(const algo::GroundDistance& ground) : ground_(ground) {
    for (int p = 0; p < ground.bins(); ++p) {
        for (int q = 0; q < ground.bins(); ++q) cost_.push_back(std::llround(ground(p, q) * kCostScale));
    }
}

double LemonPeer::distance(const algo::Hord& a, const algo::Hord& b) {
    using Graph = lemon::SmartDigraph;
    int bin[2 * 225];
    int count[2] = {};
    for (int k = 0; k < ground_.bins(); ++k) {
        if (a.mass[k] > 0) bin[count[0]++] = k;
    }
    for (int k = 0; k < ground_.bins(); ++k) {
        if (b.mass[k] > 0) bin[count[0] + count[1]++] = k;
    }
    Graph graph;
    graph.reserveNode(count[0] + count[1]);
    graph.reserveArc(count[0] * count[1]);
    for (int n = 0; n < count[0] + count[1]; ++n) graph.addNode();
    Graph::NodeMap<std::int64_t> supply(graph);
    Graph::ArcMap<std::int64_t> cost(graph);
    for (int p = 0; p < count[0]; ++p) supply[Graph::nodeFromId(p)] = static_cast<std::int64_t>(a.mass[bin[p]]) * b.sum;
    for (int q = count[0]; q < count[0] + count[1]; ++q)
        supply[Graph::nodeFromId(q)] = -static_cast<std::int64_t>(b.mass[bin[q]]) * a.sum;
    for (int p = 0; p < count[0]; ++p) {
        for (int q = count[0]; q < count[0] + count[1]; ++q) {
            cost[graph.addArc(Graph::nodeFromId(p), Graph::nodeFromId(q))] =
                cost_[static_cast<std::size_t>(bin[p] * ground_.bins() + bin[q])];
        }
    }
    lemon::NetworkSimplex<Graph, std::int64_t, std::int64_t> simplex(graph);
    simplex.supplyMap(supply).costMap(cost).run();
    double work = 0;
    for (int arc = 0; arc < count[0] * count[1]; ++arc) {
        const std::int64_t flow = simplex.flow(Graph::arcFromId(arc));
        if (flow != 0)
            work += static_cast<double>(flow) *
                static_cast<double>(cost_[static_cast<std::size_t>(bin[arc / count[1]] * ground_.bins() +
                                                                   bin[count[0] + arc % count[1]])]);
    }
    return work / kCostScale / (static_cast<double>(a.sum) * static_cast<double>(b.sum));
}

}  // namespace hord::bench
