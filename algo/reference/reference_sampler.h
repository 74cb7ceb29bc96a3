// The reference HORD at any point between the reference's lenslets, at the light of a part: by cubic interpolation of
// the 4x4 lenslets around it, or of fewer where some have no HORD. reference_row_sampler.h is the fast path for rows of
// lenslets whose 4x4 are complete. Light of another level than the reference's: docs/notes/reference.md.
//
// Formats. Shares are Q0.15 below 1, cubic weights Q1.7, products of two Q2.14: the sum over 4x4 stays below 1.25^2 *
// 2^14 * 2^15 < 2^30 (int32, exact). Then floats, lane by lane: the same bits on every instruction set.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

#include "algo/reference/pose.h"
#include "algo/reference/reference.h"
#include "algo/simd/isa.h"

namespace hord::algo {

// The bins of a reference HORD that have light; the first and the last of their places (Reference::place).
struct LitPlaces {
    BinRect bins;
    int first = std::numeric_limits<int>::max(), last = 0;

    void cover(const LitPlaces& other) {
        bins.cover(other.bins);
        first = std::min(first, other.first), last = std::max(last, other.last);
    }
};

// A range of places in lines of sixteen, within a Reference's stride.
struct PlaceRange {
    static constexpr int kLine = 16;
    int first = 0, count = 0;
    [[nodiscard]] int end() const { return first + count * kLine; }
};

class ReferenceSampler {
  public:
    struct ReferenceHord {
        bool has_light = false;  // the reference has light there; else the rest is not valid
        bool has_hord = false;
        double light = 0;  // DN, at the reference's light
        double share = 1;  // the part's light over `light`: the sum of the reference bins
        LitPlaces lit;
        PlaceRange written;  // of `bins`
    };

    // `reference` outlives it.
    ReferenceSampler(const Reference& reference, Isa isa);

    // At the point (m, n) of the reference, in lenslets. Writes reference bins to `bins`, as shares at `light` times
    // the reference's light; only the lines of `written`. `bins` has room for a Reference's stride.
    ReferenceHord read(double m, double n, double light, float* bins) const;

    struct Taps {  // input of the interpolation
        const std::uint16_t* from[16];
        alignas(32) std::int16_t weights[16];  // 0 where there is none; Q1.14
        float light, clip;  // the part's light over the reference's; clip_dn over the lenslet's light
    };

  private:
    const Reference& reference_;
    std::vector<LitPlaces> lit_;  // one a lenslet

    float (*gather_)(const Taps& taps, PlaceRange lines, float* out);
};

}  // namespace hord::algo
