// The reference HORD at any place between the reference's lenslets, at the light that a part has: by cubic
// interpolation of the 4x4 lenslets around it, of fewer where some have none. Along a part's row
// reference_row_sampler.h does the same for many lenslets at once, where all of the 4x4 have one.
//
// Another light. The dark level cuts `clip` DN off every lit bin, whatever its light. A part with s times the
// reference's light G = n g has s (G + clip) - clip; bins with less than clip in proportion: s G - (1 - s) min(clip,
// G).
//
// Formats. Shares are Q0.15 below 1, cubic weights Q1.7, products of two Q2.14: the sum over 4x4 stays below 1.25^2 *
// 2^14 * 2^15 < 2^30 (int32, exact). Then floats, lane by lane: the same bits on every instruction set.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/reference/pose.h"
#include "algo/reference/reference.h"
#include "algo/simd/isa.h"

namespace hord::algo {

// Where a reference HORD has light: places as Reference::place, and their columns and rows, the border's bins counted.
class LitPlaces {
  public:
    void cover(int place, int column, int row) { cover(all_of(place, column, row)); }
    void cover(const LitPlaces& other) { most_ = other.most_ > most_ ? other.most_ : most_; }

    [[nodiscard]] bool none() const { return last() == 0; }
    [[nodiscard]] int first() const { return -most_[0]; }
    [[nodiscard]] int last() const { return most_[1]; }
    [[nodiscard]] int left() const { return -most_[2]; }
    [[nodiscard]] int right() const { return most_[3]; }
    [[nodiscard]] int top() const { return -most_[4]; }
    [[nodiscard]] int bottom() const { return most_[5]; }

  private:
    using Most = std::int16_t __attribute__((vector_size(16)));  // one instruction for all: the least are negative
    static constexpr std::int16_t kFar = 32767;
    Most most_{-kFar, 0, -kFar, 0, -kFar, 0, 0, 0};

    static LitPlaces all_of(int place, int column, int row) {
        const auto p = static_cast<std::int16_t>(place), c = static_cast<std::int16_t>(column),
                   r = static_cast<std::int16_t>(row);
        const auto minus = [](std::int16_t v) { return static_cast<std::int16_t>(-v); };
        LitPlaces lit;
        lit.most_ = Most{minus(p), p, minus(c), c, minus(r), r, 0, 0};
        return lit;
    }
};

// Lines of sixteen places, the last one not beyond a Reference's stride.
struct ReferenceLines {
    static constexpr int kLine = 16;
    int first = 0, count = 0;
    [[nodiscard]] int end() const { return first + count * kLine; }
};

class ReferenceSampler {
  public:
    struct ReferenceHord {
        bool known = false;  // there is light that is known
        bool has_hord = false;
        double light = 0;  // DN, at the reference's light
        double share = 1;  // of it the part has, at its light: what the reference bins add up to
        LitPlaces lit;
        ReferenceLines written;  // of the bins
    };

    // `reference` outlives it.
    ReferenceSampler(const Reference& reference, Isa isa);

    // At a place of the reference, lenslets. `bins` receives lines of reference bins, as shares at `light` times the
    // reference's light; the rest of it is left alone. There is room for a Reference's stride.
    ReferenceHord read(double m, double n, double light, float* bins) const;

    struct Taps {
        const std::uint16_t* from[16];
        alignas(32) std::int16_t weights[16];  // 0 where there is none; Q1.14
        float light, clip;                     // the part's over the reference's; of the lenslet's light
    };

  private:
    const Reference& reference_;
    std::vector<LitPlaces> lit_;  // one a lenslet

    float (*gather_)(const Taps& taps, ReferenceLines lines, float* out);
};

}  // namespace hord::algo
