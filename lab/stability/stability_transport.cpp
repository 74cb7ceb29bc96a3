// Transport problems at the extremes: ties, odd direction maps; against two independent solvers.
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include <fmt/format.h>

#include "algo/emd/emd_solver.h"
#include "lab/experiment/transport_check.h"
#include "lab/stability/stability.h"

namespace hord::lab {
namespace {

using algo::Direction;
using algo::EmdSolver;
using algo::GroundDistance;
using algo::GroundNorm;
using Random = std::mt19937_64;

constexpr double kExact = 1e-9;    // bin pitches, for costs up to 20; in proportion above (algo/emd/emd_solver.h)
constexpr int kPivotsANode = 200;  // the bound of algo/emd/transport_simplex.h

algo::Hord hord(const Masses& h) { return {h.data(), std::accumulate(h.begin(), h.end(), std::uint32_t{0})}; }

double tolerance(const GroundDistance& ground) { return kExact * std::max(1.0, ground.largest() / 20); }

Masses knapsack_masses(Random& random, int bins, int lit, int most) {
    Masses h(static_cast<std::size_t>(bins));
    for (int k = 0; k < lit; ++k)
        h[random() % h.size()] = static_cast<std::uint16_t>(1 + random() % static_cast<unsigned>(most));
    return h;
}

// Small equal masses on a small grid, shuffled: nearly every pivot is a tie.
void ties(const StabilityOptions& options, StabilityTable& table) {
    table.begin("degenerate transport ties");
    struct Kind {
        const char* name;
        GroundDistance ground;
    };
    const Kind kinds[] = {
        {"3x3 bins, Euclidean", *GroundDistance::between_bins(3, 3)},
        {"4x3 bins, Manhattan", *GroundDistance::between_bins(4, 3, GroundNorm::manhattan)},
        {"3x4 bins, squared Euclidean", *GroundDistance::between_bins(3, 4, GroundNorm::squared_euclidean)},
        {"5x5 bins, cut off at 2", *GroundDistance::between_bins(5, 5, GroundNorm::euclidean, 2.0)}};
    const int pairs = options.degenerate_pairs / static_cast<int>(std::size(kinds));
    Random random(options.seed + 3);
    for (std::size_t k = 0; k < std::size(kinds); ++k) {
        auto solver = *EmdSolver::create(kinds[k].ground);
        const int bins = kinds[k].ground.bins();
        double worst = 0;
        std::uint64_t most_pivots = 0;
        for (int n = 0; n < pairs; ++n) {
            Masses a = knapsack_masses(random, bins, 3 + static_cast<int>(random() % static_cast<unsigned>(bins)),
                                       1 + n % 3),
                   b = a;
            std::shuffle(b.begin(), b.end(), random);
            const std::uint64_t before = solver.counters().pivots;
            worst = std::max(
                worst, std::abs(solver.distance(hord(a), hord(b)) - distance_by_shortest_paths(a, b, kinds[k].ground)));
            most_pivots = std::max(most_pivots, solver.counters().pivots - before);
            if (n % 4096 == 0)
                options.progress(0.2 +
                                 0.7 * (static_cast<double>(k) + static_cast<double>(n) / pairs) /
                                     static_cast<double>(std::size(kinds)));
        }
        table.at_most(fmt::format("{}: worst difference from shortest paths, {} pairs", kinds[k].name, pairs), kExact,
                      worst);
        table.at_most(fmt::format("{}: pivots of the slowest pair", kinds[k].name), kPivotsANode * 2.0 * bins,
                      static_cast<double>(most_pivots));
        table.same(fmt::format("{}: plans given up without a proof", kinds[k].name), 0,
                   static_cast<std::int64_t>(solver.counters().unproven));
    }
    // Alternate bins with one unit each: the largest problem in which every pivot may be a tie.
    Masses half(15 * 14), other(15 * 14);
    for (std::size_t k = 0; k < half.size(); ++k) (((k % 15) + (k / 15)) % 2 == 0 ? half : other)[k] = 1;
    for (const GroundNorm norm : {GroundNorm::euclidean, GroundNorm::manhattan, GroundNorm::squared_euclidean}) {
        auto solver = *EmdSolver::create(*GroundDistance::between_bins(15, 14, norm));
        table.near(
            fmt::format("chequerboard of photons and its negative, 15x14 bins, ground {}", static_cast<int>(norm)), 1,
            solver.distance(hord(half), hord(other)), kExact);
        table.same("its plans given up without a proof", 0, static_cast<std::int64_t>(solver.counters().unproven));
    }
}

void direction_maps(const StabilityOptions& options, StabilityTable& table) {
    table.begin("direction maps");
    Random random(options.seed + 4);
    std::uniform_real_distribution<double> unit(-1, 1);
    const auto drawn = [&](double scale) {
        std::vector<Direction> map(25);
        for (Direction& d : map) d = {scale * unit(random), scale * unit(random)};
        return map;
    };
    const std::vector<Direction> same(25, Direction{3, -4});
    auto pairs_apart = drawn(4);
    for (std::size_t k = 1; k < pairs_apart.size(); k += 2) pairs_apart[k] = pairs_apart[k - 1];
    auto one_far = drawn(1);
    one_far[12] = {GroundDistance::kMaxDirection, -GroundDistance::kMaxDirection};
    std::vector<Direction> nearly_regular(25);  // costs that are equal as floats
    for (std::size_t k = 0; k < 25; ++k)
        nearly_regular[k] = {static_cast<double>(k % 5) + 1e-6 * unit(random),
                             static_cast<double>(k / 5) + 1e-6 * unit(random)};
    struct Kind {
        std::string name;
        std::vector<Direction> map;
    };
    const Kind kinds[] = {{"all directions coincide", same},
                          {"every direction twice", pairs_apart},
                          {"a millionth of a bin from regular", nearly_regular},
                          {"one direction 1e6 bins away", one_far},
                          {"directions up to 1e6 bins", drawn(GroundDistance::kMaxDirection)},
                          {"directions within 1e-12 bins", drawn(1e-12)}};
    for (const Kind& kind : kinds) {
        for (const GroundNorm norm : {GroundNorm::euclidean, GroundNorm::manhattan, GroundNorm::squared_euclidean}) {
            const auto ground = *GroundDistance::between_directions(5, 5, kind.map, norm);
            auto solver = *EmdSolver::create(ground);
            double worst = 0;
            std::int64_t unreal = 0;
            for (int n = 0; n < options.random_pairs / 4; ++n) {
                const Masses a = knapsack_masses(random, 25, 1 + n % 25, 255),
                             b = knapsack_masses(random, 25, 1 + n % 13, 255);
                const double distance = solver.distance(hord(a), hord(b));
                unreal += std::isfinite(distance) ? 0 : 1;
                worst = std::max(worst, std::abs(distance - distance_by_shortest_paths(a, b, ground)));
            }
            const char* squared = norm == GroundNorm::squared_euclidean ? ", squared"
                : norm == GroundNorm::manhattan                         ? ", Manhattan"
                                                                        : "";
            table.at_most(kind.name + squared + ": worst difference from shortest paths", tolerance(ground), worst);
            table.same(kind.name + squared + ": NaN, infinite, or given up", 0,
                       unreal + static_cast<std::int64_t>(solver.counters().unproven));
        }
    }
    const auto refused = [&](const char* what, Direction wrong) {
        auto map = drawn(1);
        map[7] = wrong;
        const auto made = GroundDistance::between_directions(5, 5, map);
        table.holds(what, "refused, with a cure", made ? "accepted" : made.error().message(),
                    !made && !made.error().cure.empty());
    };
    refused("a direction that is NaN", {std::nan(""), 0});
    refused("an infinite direction", {0, -HUGE_VAL});
    refused("a direction beyond 1e6 bins", {1.1e6, 0});
}

// Sinkhorn's result counts only where the marginals of its plan are accurate; then it bounds the exact distance.
void entropic(const StabilityOptions& options, StabilityTable& table) {
    table.begin("entropic cross-check (Sinkhorn, log domain)");
    Random random(options.seed + 5);
    const auto ground = *GroundDistance::between_bins(9, 9);
    auto solver = *EmdSolver::create(ground);
    for (const double epsilon : {0.5, 0.1, 0.02}) {
        constexpr double kResidual = 1e-6;
        int counted = 0, outside = 0;
        double bias = 0;
        const int pairs = std::max(8, options.random_pairs / 100);
        for (int n = 0; n < pairs; ++n) {
            const Masses a = knapsack_masses(random, 81, 3 + n % 20, 255),
                         b = knapsack_masses(random, 81, 3 + n % 17, 255);
            const Sinkhorn s = sinkhorn(a, b, ground, epsilon, kResidual, 1000);
            if (!(s.residual <= kResidual)) continue;
            ++counted;
            const double exact = solver.distance(hord(a), hord(b)), slack = kResidual * ground.largest() + kExact;
            outside += s.cost >= exact - slack && s.cost <= exact + s.bias + slack ? 0 : 1;
            bias = std::max(bias, s.cost - exact);
        }
        table.same(
            fmt::format(
                "epsilon {}: exact distances outside the bracket, of {} of {} that converged (largest bias {:.2g})",
                epsilon, counted, pairs, bias),
            0, outside);
    }
}

}  // namespace

void check_transport(const StabilityOptions& options, StabilityTable& table) {
    direction_maps(options, table);
    entropic(options, table);
    ties(options, table);
}

}  // namespace hord::lab
