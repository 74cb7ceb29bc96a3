// What varies between good parts: mean, spread and first modes of their maps of light and mean deflection, each part at
// the reference's pose. For pictures and reports; a verdict uses algo/reference alone.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/reference/pose.h"
#include "algo/reference/reference.h"
#include "common/frame.h"

namespace hord::algo {

// One value a lenslet of Variation::grid.
struct PartMapSet {
    std::vector<float> light;  // 1: the part's typical lenslet
    std::vector<float> x, y;   // mean deflection, bin pitches
};

struct VariationMode {
    double share = 0;             // of the variance in units of noise, 0..1
    PartMapSet maps;              // what changes at one standard deviation of this mode
    std::vector<double> amounts;  // of each part, in standard deviations
};

struct Variation {
    Extents grid;  // every step-th lenslet of every step-th row
    int step = 1;
    std::size_t parts = 0;
    std::vector<std::uint8_t> mask;    // MaskBit: kDark where too few parts have light
    PartMapSet mean, spread;           // spread: standard deviation, photon noise included
    std::vector<VariationMode> modes;  // the largest first
    // The share that each mode would have if parts differed by noise alone.
    [[nodiscard]] double share_by_noise() const { return parts > 1 ? 1.0 / static_cast<double>(parts - 1) : 1; }
};

class VariationMeter {
  public:
    static constexpr std::size_t kMaxParts = 200;  // further parts are not used
    static constexpr int kMaxSide = 111;           // of the grid

    explicit VariationMeter(const Reference& reference);  // which outlives it

    // A part's frame and its pose relative to the reference.
    void add(const FrameView& frame, const Pose& pose);

    // Empty maps for no parts.
    [[nodiscard]] Variation finish(std::size_t modes) const;

  private:
    void add_mean_and_spread(Variation& variation) const;

    const Reference& reference_;
    int step_;
    Extents grid_;
    std::vector<PartMapSet> parts_;  // NaN: no value
};

}  // namespace hord::algo
