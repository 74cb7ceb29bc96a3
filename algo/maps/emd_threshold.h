// Is the EMD gradient of a lenslet at or above a limit? For a whole frame, mostly without solving.
//
// Every pair is bracketed first (algo/emd/emd_bounds.h). Only where the limit lies inside the bracket of the gradient's
// norm are its distances solved exactly, side by side. A decision is the one that the exact map gives, for every
// lenslet: `exact >= limit` with `exact` the float that a FeatureMapper writes. (Brackets hold the very double that the
// solver returns, and squares, sums, roots and the conversion to float keep order.) Test:
// tests/algo/maps/emd_threshold_test.cpp, on millions of pairs with HORD_LONG_TESTS.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "algo/emd/ground_distance.h"
#include "algo/frame/decode.h"

namespace hord::algo {

struct DecisionMap {
    std::span<const std::uint8_t>
        reached;  // row by row; 1: at or above the limit; 0 also where `mask` says there is no value
    std::span<const std::uint8_t> mask;  // MaskBit
    std::uint64_t pairs = 0;             // distances that the exact map would have taken
    std::uint64_t solved = 0;            // of them, those that were solved
};

// Rows are streamed as in algo/maps/feature_map.h: no allocation after create(), the same answer for any number of
// threads. Not thread-safe.
class EmdDecisions {
  public:
    // Fails with invalid_argument when the extents, bits or number of threads are impossible or the ground distance has
    // other bins; with busy when the system gives no thread.
    static Result<EmdDecisions> create(const Extents& extents, int bits, const LightLevels& levels,
                                       const GroundDistance& ground, int threads = 1);

    // limit: in the ground distance's unit. The spans stay valid until the next call. Fails with invalid_argument when
    // a frame's size or depth is not what create() was told, or the limit is not a number.
    Result<DecisionMap> decide(const FrameView& frame, float limit);
    // The same for the distance from a reference frame's HORD at the same place.
    Result<DecisionMap> decide_against(const FrameView& frame, const FrameView& reference, float limit);

    EmdDecisions(EmdDecisions&&) noexcept;
    EmdDecisions& operator=(EmdDecisions&&) noexcept;
    ~EmdDecisions();

  private:
    struct State;
    explicit EmdDecisions(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

}  // namespace hord::algo
