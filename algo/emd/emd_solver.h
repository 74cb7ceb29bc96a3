// Earth mover's distance between two HORDs (Eqs. 9-11), exact.
//
// Masses. h = a / S_a and g = b / S_b are never divided out. Over the common denominator S_a * S_b their
// difference is d = a * S_b - b * S_a, an integer: nothing is rounded before the cost is evaluated.
//   range    a mass < 2^16 and a sum < 2^24, so |d| < 2^40 and the mass on either side is at most
//            S_a * S_b < 2^48. Masses are std::int32_t where that is below 2^31, else doubles, which hold every integer
//            up to 2^53: no overflow, no rounding in any sum, difference or minimum of them.
//   error    costs and dual variables are doubles. A plan is accepted only when every reduced cost, computed in
//            double precision, is at least -2^-36 of the largest cost; the result is that plan's cost. So it is above
//            the exact distance by less than 1e-9 bin pitches (see transport_simplex.h), and never NaN or infinite.
//   bits     the same on every instruction set and compiler: only +, -, *, /, sqrt, in a fixed order, not contracted.
// Where the ground distance is a metric the mass both share bin by bin is cancelled; otherwise it is kept.
//
// Tests: tests/algo/emd/sparse_hord_test.cpp, emd_solver_test.cpp (literals, LEMON as oracle, degenerate ties,
// properties).
#pragma once

#include <cstdint>
#include <memory>

#include "algo/emd/ground_distance.h"
#include "algo/emd/sparse_hord.h"
#include "algo/frame/hord.h"
#include "common/result.h"

namespace hord::algo {

// Not thread-safe: give each thread its own. Allocates only in create().
class EmdSolver {
  public:
    // Cannot fail for a GroundDistance that was made; a Result so that it reads like its siblings.
    // `isa`: what its vectors are made for; the results are the same to the last bit. Not `portable`, it takes the
    // instructions of AVX-512 that find and close up what has to move, where there are any, too.
    static Result<EmdSolver> create(const GroundDistance& ground, Isa isa = best_isa());

    // The distance between two HORDs with the ground distance's number of bins, in its unit; exactly symmetric.
    // 0 when either is dark (sum 0): a caller masks those, there is no distance to a HORD that does not exist.
    [[nodiscard]] double distance(const Hord& a, const Hord& b);

    // The same for many pairs, several times faster: small problems of one shape are collected and solved side by side.
    // *out is written by submit() or a later call, at the latest by finish(); it must stay valid until then, belongs to
    // this pair alone, and is no distance before. The HORDs need not outlive submit(). Same bits as distance(). Call
    // finish() as rarely as the memory for `out` allows.
    void submit(const Hord& a, const Hord& b, double* out);
    void finish();

    // The same of HORDs that a compact() has closed up: faster where few bins are lit and each HORD belongs to several
    // pairs (docs/results/features.md).
    void submit(const SparseHord& a, const SparseHord& b, double* out);
    [[nodiscard]] CloseUp compact() const;

    // What was done since create(). `unproven` counts plans returned at the pivot limit without a proof that they
    // are optimal; the tree is kept strongly feasible, so that it stays 0 (tested).
    struct Work {
        std::uint64_t pairs = 0;
        std::uint64_t few = 0;      // of them, solved by knapsack_batch.h
        std::uint64_t small = 0;    // by transport_batch.h
        std::uint64_t simplex = 0;  // or by transport_simplex.h, from their plan on or alone; the rest need none
        std::uint64_t pivots = 0;
        std::uint64_t unproven = 0;
    };
    [[nodiscard]] const Work& work() const;

    EmdSolver(EmdSolver&&) noexcept;
    EmdSolver& operator=(EmdSolver&&) noexcept;
    ~EmdSolver();

  private:
    struct State;
    explicit EmdSolver(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

}  // namespace hord::algo
