// The reference HORD at any point between the reference's lenslets, at the light of a part: by cubic interpolation of
// the 4x4 lenslets around it, or of fewer where some have no HORD. reference_row_sampler.h is the fast path for rows of
// lenslets whose 4x4 are complete. Light of another level than the reference's: docs/notes/reference.md.
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

// The range of places (Reference::place), columns and rows of a reference HORD that have light, border bins included.
class LitPlaces {
  public:
    void cover(int place, int column, int row) { cover(all_of(place, column, row)); }
    void cover(const LitPlaces& other) { maxima_ = other.maxima_ > maxima_ ? other.maxima_ : maxima_; }

    [[nodiscard]] bool none() const { return last() == 0; }
    [[nodiscard]] int first() const { return -maxima_[0]; }
    [[nodiscard]] int last() const { return maxima_[1]; }
    [[nodiscard]] int left() const { return -maxima_[2]; }
    [[nodiscard]] int right() const { return maxima_[3]; }
    [[nodiscard]] int top() const { return -maxima_[4]; }
    [[nodiscard]] int bottom() const { return maxima_[5]; }

  private:
    using Maxima = std::int16_t __attribute__((vector_size(16)));  // minima are stored negated: one instruction for all
    static constexpr std::int16_t kFar = 32767;
    Maxima maxima_{-kFar, 0, -kFar, 0, -kFar, 0, 0, 0};

    static LitPlaces all_of(int place, int column, int row) {
        const auto p = static_cast<std::int16_t>(place), c = static_cast<std::int16_t>(column),
                   r = static_cast<std::int16_t>(row);
        const auto minus = [](std::int16_t v) { return static_cast<std::int16_t>(-v); };
        LitPlaces lit;
        lit.maxima_ = Maxima{minus(p), p, minus(c), c, minus(r), r, 0, 0};
        return lit;
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
