// The distances between two HORDs, chosen by name (algo/features/feature.h), with one interface.
//
// All are built from d = a * S_b - b * S_a and s = a * S_b + b * S_a (emd_solver.h), exact in doubles; then only +, -,
// *, / and sqrt in the order of the bins: the same bits on every platform. Results are finite; absolute error < 1e-9
// (emd: emd_solver.h). Test: tests/algo/features/distance_test.cpp, against the definitions in long double.
//
//   centroid       |mean(a) - mean(b)| of the directions, for directions up to 1e3
//   marginal       sqrt(W1x^2 + W1y^2), W1 of the marginals: between centroid and emd
//   sliced         sin(pi/2K) * sum of W1 over K = 8 projections at equal angles: at most emd (docs/notes/features.md)
//   max-sliced     the largest W1 over the same 8 projections: at most emd, at least 0.98 of the largest over all
//   angles cramer-von-mises  sqrt of the generalised distance of algo/features/cramer_von_mises.h, widths up to the
//   bins of the
//                  longer side; absolute error < 1e-7
//   hellinger      sqrt(sum (sqrt(h) - sqrt(g))^2 / 2), 0 equal .. 1 disjoint
//   chi2           sum (h - g)^2 / (h + g) / 2, 0 equal .. 1 disjoint
//   bhattacharyya  -ln sum sqrt(h g); kBhattacharyyaLimit instead of infinity if disjoint, counted by saturated()
#pragma once

#include <cstdint>
#include <span>

#include "algo/emd/ground_distance.h"
#include "algo/emd/sparse_hord.h"
#include "algo/features/feature.h"
#include "algo/frame/hord.h"
#include "algo/simd/isa.h"
#include "common/opaque.h"
#include "common/result.h"

namespace hord::algo {

inline constexpr double kBhattacharyyaLimit = 0x1.0a2b23f3bab73p+4;  // 24 ln 2

struct DistanceOptions {
    std::span<const Direction> directions = {};       // one per bin, in bin pitches; empty: bins one pitch apart
    double threshold = GroundDistance::kNoThreshold;  // of the ground distance, for the emd features
};

// Not thread-safe. Allocates only in create().
class Distance {
  public:
    using Options = DistanceOptions;

    // Fails with invalid_argument when the feature is not a distance, or as GroundDistance does.
    // `isa`: as for EmdSolver::create.
    static Result<Distance> create(Feature feature, int bins_i, int bins_j, const Options& options = {},
                                   Isa isa = best_isa());

    // 0 when either HORD is dark (sum 0); callers mask those.
    [[nodiscard]] double operator()(const Hord& a, const Hord& b);

    // The same, faster for many pairs: *out is written at the latest by finish() (see EmdSolver::submit).
    void submit(const Hord& a, const Hord& b, double* out);
    void submit(const SparseHord& a, const SparseHord& b, double* out);
    [[nodiscard]] CompactFunction compact() const;
    void finish();

    // Results since create() that are kBhattacharyyaLimit instead of a distance.
    [[nodiscard]] std::uint64_t saturated() const;

  private:
    struct State;
    explicit Distance(common::Opaque<State> state) : state_(std::move(state)) {}
    common::Opaque<State> state_;
};

}  // namespace hord::algo
