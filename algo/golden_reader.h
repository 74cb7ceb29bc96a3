// The golden HORD at a place between the reference's lenslets, at the light that a part has: by cubic interpolation of the 4x4 lenslets around it,
// of fewer where some have none.
//
// Another light. The dark level cuts `clip` DN off every lit bin, whatever its light. A part with s times the reference's light G = n g has
// s (G + clip) - clip; bins with less than clip in proportion: s G - (1 - s) min(clip, G).
//
// Formats. Shares are Q0.15 below 1, cubic weights products of two Q1.7, so their sum over 4x4 stays below 1.25^2 * 2^14 * 2^15 < 2^30 (int32, exact);
// then floats, lane by lane: the same bits on every instruction set.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "algo/isa.h"
#include "algo/reference.h"

namespace hord::algo {

// Where a golden HORD has light: places as Reference::place, and their columns and rows, the border's bins counted.
struct LitPlaces {
    std::uint16_t first = 65535, last = 0;
    std::uint8_t left = 255, right = 0, top = 255, bottom = 0;

    void cover(const LitPlaces& other) {
        first = std::min(first, other.first), last = std::max(last, other.last);
        left = std::min(left, other.left), right = std::max(right, other.right);
        top = std::min(top, other.top), bottom = std::max(bottom, other.bottom);
    }
};

// Lines of sixteen places, the last one not beyond a Reference's stride.
struct GoldenLines {
    static constexpr int kLine = 16;
    int first = 0, count = 0;
    [[nodiscard]] int end() const { return first + count * kLine; }
};

class GoldenReader {
  public:
    struct Golden {
        bool known = false;    // there is light that is known
        bool has_hord = false;
        double light = 0;      // DN, at the reference's light
        double share = 1;      // of it the part has, at its light: what the golden bins add up to
        LitPlaces lit;
        GoldenLines written;   // of the bins
    };

    // `reference` outlives it.
    GoldenReader(const Reference& reference, Isa isa);

    // At a place of the reference, lenslets. `bins` receives lines of golden bins, as shares at `light` times the reference's light; the rest of it is left
    // alone. There is room for a Reference's stride.
    Golden read(double m, double n, double light, float* bins) const;

    struct Taps {
        const std::uint16_t* from[16];
        alignas(32) std::int16_t weights[16];  // 0 where there is none; Q1.14
        float light, clip;                     // the part's over the reference's; of the lenslet's light
    };

  private:
    const Reference& reference_;
    std::vector<LitPlaces> lit_;             // one a lenslet
    std::vector<LitPlaces> lit_of_sixteen_;  // of the 4x4 that a lenslet begins
    std::vector<std::uint8_t> plain_;        // whether they all have a golden HORD
    float (*gather_)(const Taps& taps, GoldenLines lines, float* out);
};

}  // namespace hord::algo
