// The distances between two HORDs, under one roof: chosen by name (algo/features/feature.h), called the same way.
//
// Numbers, for all of them. Everything is built from d = a * S_b - b * S_a and s = a * S_b + b * S_a (emd_solver.h):
// integers below 2^41, exact in int64 and in a double; no product of them is formed in integers. From there on only +,
// -, *, / and sqrt of doubles, in the order of the bins: the same bits everywhere. Results are finite.
//
//   centroid       |mean(a) - mean(b)|, means over the directions. Absolute error < 1e-9 for directions up to 1e3.
//   marginal       sqrt(W1x^2 + W1y^2), W1 the distance of the marginals: between centroid and emd (Jensen). Error <
//   1e-9. sliced         sin(pi/2K) * sum of W1 over K = 8 projections of equally spaced angles: at most emd, for every
//   K
//                  (a vector's mean projection is at least 2/pi of its length times (pi/2K)/sin(pi/2K)). Error < 1e-9.
//   hellinger      sqrt(sum (sqrt(h) - sqrt(g))^2 / 2), 0 equal .. 1 disjoint. Error < 1e-9 (contract: 1e-4).
//   chi2           sum (h - g)^2 / (h + g) / 2, 0 equal .. 1 disjoint. Error < 1e-9 (contract: 1e-4).
//   bhattacharyya  -ln sum sqrt(h g). Overlapping HORDs have at most 24 ln 2 (one unit in 2^24 shared); disjoint ones
//   have
//                  an infinite distance: they get kBhattacharyyaLimit, and saturated() counts them. Error < 1e-9.
//   emd, -l1, -sq  emd_solver.h.
//
// Test: tests/algo/features/distance_test.cpp, against the definitions in long double.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "algo/emd/ground_distance.h"
#include "algo/emd/sparse_hord.h"
#include "algo/features/feature.h"
#include "algo/frame/hord.h"
#include "algo/simd/isa.h"
#include "common/result.h"

namespace hord::algo {

inline constexpr double kBhattacharyyaLimit = 0x1.0a2b23f3bab73p+4;  // 24 ln 2

// Not thread-safe. Allocates only in create().
class Distance {
  public:
    struct Options {
        std::span<const Direction> directions = {};       // one a bin, in bin pitches; none: bins one pitch apart
        double threshold = GroundDistance::kNoThreshold;  // of the ground distance, for emd and emd_l1
    };

    // Fails with invalid_argument when the feature is not a distance, or as GroundDistance does.
    // `isa`: as for EmdSolver::create.
    static Result<Distance> create(Feature feature, int bins_i, int bins_j, const Options& options,
                                   Isa isa = best_isa());
    static Result<Distance> create(Feature feature, int bins_i, int bins_j) {
        return create(feature, bins_i, bins_j, Options{});
    }

    // 0 when either HORD is dark (sum 0); callers mask those.
    [[nodiscard]] double operator()(const Hord& a, const Hord& b);

    // The same, where that is faster for many: *out is written at the latest by finish() (see EmdSolver::submit).
    void submit(const Hord& a, const Hord& b, double* out);
    void submit(const SparseHord& a, const SparseHord& b, double* out);
    [[nodiscard]] CloseUp compact() const;
    void finish();

    [[nodiscard]] Feature feature() const;
    // Results since create() that are a limit instead of a distance.
    [[nodiscard]] std::uint64_t saturated() const;

    Distance(Distance&&) noexcept;
    Distance& operator=(Distance&&) noexcept;
    ~Distance();

  private:
    struct State;
    explicit Distance(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

}  // namespace hord::algo
