// The distances between two HORDs, chosen by name (algo/features/feature.h), with one interface.
//
// Numbers. All are built from d = a * S_b - b * S_a and s = a * S_b + b * S_a (emd_solver.h): integers < 2^41, exact in
// int64 and in a double; no product of them is formed in integers. Then only +, -, *, / and sqrt of doubles, in the
// order of the bins: the same bits on every platform. Results are finite; errors are absolute.
//
//   centroid       |mean(a) - mean(b)| of the directions. Error < 1e-9 for directions up to 1e3.
//   marginal       sqrt(W1x^2 + W1y^2), W1 of the marginals: between centroid and emd (Jensen). Error < 1e-9.
//   sliced         sin(pi/2K) * sum of W1 over K = 8 projections at equal angles: at most emd for every K, because a
//                  vector's mean projection is at least 2/pi of its length times (pi/2K)/sin(pi/2K). Error < 1e-9.
//   hellinger      sqrt(sum (sqrt(h) - sqrt(g))^2 / 2), 0 equal .. 1 disjoint. Error < 1e-9 (contract: 1e-4).
//   chi2           sum (h - g)^2 / (h + g) / 2, 0 equal .. 1 disjoint. Error < 1e-9 (contract: 1e-4).
//   bhattacharyya  -ln sum sqrt(h g): at most 24 ln 2 if HORDs overlap (one unit in 2^24 shared). Disjoint ones get
//                  kBhattacharyyaLimit instead of infinity, counted by saturated(). Error < 1e-9.
//   emd, -l1, -sq  emd_solver.h.
//
// Test: tests/algo/features/distance_test.cpp, against the definitions in long double.
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
