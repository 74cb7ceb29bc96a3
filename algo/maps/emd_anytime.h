// The EMD gradient of a whole frame as exact as the time allows: a bracket [lower, upper] per lenslet that holds the
// exact value, refined where it is widest until the caller stops.
// No caller outside tests yet: the next issue takes it into production.
//
// Always upper >= exact: a judgement by `upper` misses nothing that the exact map finds. There is no clock here: the
// caller's `may_go_on` is called before every piece of work. The pieces, in order:
//   1. bounds (algo/emd/emd_bounds.h) of kRoundRows rows. Rows not yet bounded have the bracket [0, largest possible
//      value] and a provisional mask: valid except at the edge of the field
//   2. exact solves of kLensletsPerPiece lenslets, widest brackets first (if equal, the upper left first)
// Brackets depend on the number of pieces, but not on the number of threads.
//
// Numbers: bounds hold the double that the solver returns and are rounded outwards to floats. For a solved lenslet,
// lower and upper are the float of FeatureMapper. Test: tests/algo/maps/emd_anytime_test.cpp.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "algo/emd/ground_distance.h"
#include "algo/frame/decode.h"

namespace hord::algo {

struct BracketMap {
    std::span<const float> lower, upper;  // row by row, in the ground distance's unit; 0 where there is no value
    std::span<const std::uint8_t> mask;   // MaskBit
    int rows_bounded = 0;                 // rows with computed bounds, from the top
    std::size_t open = 0;                 // lenslets of these rows that are not exact yet
    [[nodiscard]] bool exact(int rows) const { return rows_bounded == rows && open == 0; }
};

// No allocation after create(). Not thread-safe.
class AnytimeEmdMap {
  public:
    static constexpr int kRoundRows = 32;
    static constexpr int kLensletsPerPiece = 256;

    // Fails as EmdThresholdMap::create().
    static Result<AnytimeEmdMap> create(const Extents& extents, int bits, const LightLevels& levels,
                                        const GroundDistance& ground, int threads = 1);

    // Starts a frame and refines; the frame must stay valid until the last refine(). The next call overwrites the
    // spans. Fails with invalid_argument if the frame's size or depth differs from create()'s.
    Result<BracketMap> start(const FrameView& frame, const std::function<bool()>& may_go_on);
    // Continues where the last call stopped; after start().
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
