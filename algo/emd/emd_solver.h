// The exact earth mover's distance (EMD) between two HORDs (Eqs. 9-11), by the cheapest of three solvers that covers
// the pair and proves its plan optimal: knapsack_batch.h, transport_batch.h, transport_simplex.h. Which pair goes to
// which, ranges and errors: docs/notes/emd.md.
//
// Masses. Over the common denominator S_a * S_b the difference of h = a / S_a and g = b / S_b is d = a * S_b - b * S_a,
// an integer: |d| < 2^40, the mass of a side < 2^48. All sums, differences and minima of masses are exact.
//   error  less than 1e-9 bin pitches above the exact distance; never NaN or infinite.
//   bits   the same on every instruction set and compiler: only +, -, *, /, sqrt, in fixed order, without contraction.
// Mass that both HORDs share in a bin is cancelled if the ground distance is a metric, and kept otherwise.
// Tests: tests/algo/emd/emd_solver_test.cpp (LEMON as oracle), sparse_hord_test.cpp.
#pragma once

#include <cstdint>

#include "algo/emd/ground_distance.h"
#include "algo/emd/sparse_hord.h"
#include "algo/frame/hord.h"
#include "common/opaque.h"
#include "common/result.h"

namespace hord::algo {

// Not thread-safe. Allocates only in create().
class EmdSolver {
  public:
    // Fails with unsupported if the processor lacks `isa`. The results are the same bits for every isa; for any but
    // `portable`, AVX-512 instructions are also used where they exist.
    static Result<EmdSolver> create(const GroundDistance& ground, Isa isa = best_isa());

    // The distance between two HORDs with the ground distance's number of bins, in its unit; exactly symmetric.
    // 0 if either is dark (sum 0): callers mask those.
    [[nodiscard]] double distance(const Hord& a, const Hord& b);

    // The same bits for many pairs, several times faster: small problems of one shape are solved as a batch.
    // *out is written at the latest by finish(). Until then it must stay valid, belong to this pair alone and not be
    // read. The masses are not read after submit(). Call finish() as rarely as the memory for `out` allows.
    void submit(const Hord& a, const Hord& b, double* out);
    void finish();

    // The same for HORDs from compact(): faster if few bins are lit and each HORD belongs to several pairs
    // (docs/results/features.md).
    void submit(const SparseHord& a, const SparseHord& b, double* out);
    [[nodiscard]] CompactFunction compact() const;

    // Counts since create(). `unproven`: plans returned at the pivot limit without proof that they are optimal; stays 0
    // because the tree is kept strongly feasible (tested).
    struct Counters {
        std::uint64_t pairs = 0;
        std::uint64_t knapsack = 0;   // pairs solved by knapsack_batch.h
        std::uint64_t transport = 0;  // pairs given to transport_batch.h
        std::uint64_t simplex = 0;    // pairs solved by transport_simplex.h, with or without a plan to start from
        std::uint64_t pivots = 0;
        std::uint64_t unproven = 0;
    };
    [[nodiscard]] const Counters& counters() const;

  private:
    struct State;
    explicit EmdSolver(common::Opaque<State> state) : state_(std::move(state)) {}
    common::Opaque<State> state_;
};

}  // namespace hord::algo
