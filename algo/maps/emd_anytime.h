// The EMD gradient of a whole frame as good as the time allows: for every lenslet a bracket [lower, upper] that holds
// the exact value, refined where it is widest until the caller says stop.
//
// Whoever judges by `upper` never misses what the exact map would have found: upper >= exact, always. There is no clock
// here: the caller's `may_go_on` is asked before every piece of work and counts, or looks at a clock. The pieces, in
// order:
//   1. brackets from bounds (algo/emd/emd_bounds.h), kRoundRows rows a piece; rows not yet reached have the widest
//   bracket there is,
//      [0, what the ground distance allows], and an unknown mask: valid, but for the field's edge
//   2. exact solves, kLensletsAPiece lenslets a piece, the widest brackets first (of equally wide ones the upper left
//   first)
// Brackets depend on how many pieces were allowed, and not on the number of threads.
//
// Numbers: the bounds hold the double that the solver returns; they are rounded outwards to floats. Where a lenslet was
// solved, lower and upper are the float that a FeatureMapper writes. Test: tests/algo/maps/emd_anytime_test.cpp.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "algo/emd/ground_distance.h"
#include "algo/frame/decode.h"

namespace hord::algo {

struct BracketMap {
    std::span<const float> lower,
        upper;  // row by row, in the ground distance's unit; 0 where `mask` says there is no value
    std::span<const std::uint8_t> mask;  // MaskBit
    int rows_bounded = 0;                // rows whose brackets come from bounds, from the top
    std::size_t open = 0;                // lenslets in them that are not exact yet
    [[nodiscard]] bool exact(int rows) const { return rows_bounded == rows && open == 0; }
};

// No allocation after create(). Not thread-safe.
class AnytimeEmdMap {
  public:
    static constexpr int kRoundRows = 32;
    static constexpr int kLensletsAPiece = 256;

    // Fails as EmdDecisions::create does.
    static Result<AnytimeEmdMap> create(const Extents& extents, int bits, const LightLevels& levels,
                                        const GroundDistance& ground, int threads = 1);

    // Starts on a frame and refines; the frame must stay valid until the last refine(). The spans are written by the
    // next call. Fails with invalid_argument when the frame's size or depth is not what create() was told.
    Result<BracketMap> start(const FrameView& frame, const std::function<bool()>& may_go_on);
    // Goes on where the last call stopped; after start().
    BracketMap refine(const std::function<bool()>& may_go_on);

    AnytimeEmdMap(AnytimeEmdMap&&) noexcept;
    AnytimeEmdMap& operator=(AnytimeEmdMap&&) noexcept;
    ~AnytimeEmdMap();

  private:
    struct State;
    explicit AnytimeEmdMap(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

}  // namespace hord::algo
