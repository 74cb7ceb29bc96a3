// Upper bounds of the EMD gradient (algo/features/gradient.h), sixteen lenslets at a time: the cost of two plans that
// need no search. Bins one pitch apart, Euclidean ground.
//
// A bound is at least the float that the exact gradient rounds to, rounding of this computation included: it is
// widened by kRelativeMargin of itself and kMarginBins a pair. It is finite, and 0 where the mask has no gradient.
// The same bits on every instruction set. The time depends on which bins hold more than faint light. Plans, proof and
// tightness: docs/notes/emd.md.
// Test: tests/algo/soa/soa_emd_bounds_test.cpp, against EmdSolver.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "algo/simd/aligned.h"
#include "algo/soa/soa_distances.h"

namespace hord::algo {

// Lit bins of a block of lenslets, and of those it is compared with: columns first_i..last_i, lines first_j..last_j.
struct LitBox {
    int first_i = 0, last_i = -1, first_j = 0, last_j = -1;
    [[nodiscard]] int bins() const { return std::max(last_i - first_i + 1, 0) * std::max(last_j - first_j + 1, 0); }
    // Bin pitches, between the middles of its outermost bins; no light moves farther.
    [[nodiscard]] float diagonal() const {
        return std::hypot(static_cast<float>(std::max(last_i - first_i, 0)),
                          static_cast<float>(std::max(last_j - first_j, 0)));
    }
};

class SoaEmdBounds {
  public:
    static constexpr float kRelativeMargin = 0x1p-13F;
    static constexpr float kMarginBins = 0x1p-11F;  // bin pitches, of the EMD of a pair

    SoaEmdBounds(const Extents& extents, Isa isa);

    // Bounds of row n, bin pitches; 0 where `mask` has one of the bits `left_out`, which include kNoGradient. `rows`:
    // made for Feature::emd, with the lenslets that are not left out, and their neighbours, loaded. No allocation.
    // Where the box of a block or of those it is compared with has more than `most_bins` bins, the bounds are twice its
    // diagonals: of any use only if it does not matter how large a value is.
    void row(const SoaDistances& rows, int n, const std::uint8_t* mask, std::uint8_t left_out, float* upper,
             int most_bins = kMaxBinCount) const;

  private:
    [[nodiscard]] LitBox box_of(const SoaRow::Lit& lit) const;
    [[nodiscard]] float alone(const SoaRow& a, int m_a, const SoaRow& b, int m_b) const;

    // Upper bounds of the EMD of sixteen pairs: those of arrays a and b, a bin `stride` after the bin before.
    using Bound = void (*)(const float* a, const float* b, std::size_t stride, int bins_i, const LitBox& box,
                           float* upper);
    Extents extents_;
    Bound bound_;
};

}  // namespace hord::algo
