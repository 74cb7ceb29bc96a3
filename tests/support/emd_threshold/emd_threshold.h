// Decides for every lenslet of a frame whether its EMD gradient is at or above a limit, mostly without solving.
// Benches measure it; the pipeline computes every distance.
//
// Every pair is bounded first (tests/support/emd_threshold/emd_bounds.h). Distances are solved exactly only where the
// limit lies between the bounds of the gradient's norm. Every decision equals `exact >= limit` with `exact` the float
// of FeatureMapper: bounds hold the double that the solver returns, and squares, sums, roots and conversion to float
// are monotonic. Test: tests/support/emd_threshold/emd_threshold_test.cpp, on millions of pairs with HORD_LONG_TESTS.
#pragma once

#include <cstdint>
#include <span>

#include "algo/emd/ground_distance.h"
#include "algo/frame/decode.h"
#include "common/opaque.h"

namespace hord::algo {

struct DecisionMap {
    std::span<const std::uint8_t> at_or_above;  // row by row; 1: at or above the limit; 0 also where there is no value
    std::span<const std::uint8_t> mask;         // MaskBit
    std::uint64_t pairs = 0;                    // distances that the exact map computes
    std::uint64_t solved = 0;                   // of them, those solved here
};

// Rows are streamed as in algo/maps/feature_map.h: no allocation after create(), the same answer for any number of
// threads. Not thread-safe.
class EmdThresholdMap {
  public:
    // Fails with invalid_argument if extents, bits or threads are invalid or the ground distance has other bins; with
    // busy if no thread can be started.
    static Result<EmdThresholdMap> create(const Extents& extents, int bits, const LightLevels& levels,
                                          const GroundDistance& ground, int threads = 1);

    // limit: in the ground distance's unit. The spans stay valid until the next call. Fails with invalid_argument if a
    // frame's size or depth differs from create()'s, or the limit is NaN.
    Result<DecisionMap> decide(const FrameView& frame, float limit);

  private:
    struct State;
    explicit EmdThresholdMap(common::Opaque<State> state) : state_(std::move(state)) {}
    common::Opaque<State> state_;
};

}  // namespace hord::algo
