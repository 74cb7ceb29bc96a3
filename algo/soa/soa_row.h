// A row of lenslets in a structure-of-arrays (SoA) layout: the values of one bin for neighbouring lenslets are
// contiguous, so that sixteen lenslets are processed at once. Bins dark in a whole block are neither stored nor read.
//
// Masses, sums and moments are the integers of algo/frame/decode.h, exact. Shares are floats: h = mass / sum (Eq. 8) or
// its root, each wrong by less than 2^-22 of itself (docs/notes/features.md). The same bits on every instruction set.
// Test: tests/algo/soa/soa_distances_test.cpp.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/frame/decode.h"
#include "algo/simd/aligned.h"
#include "algo/simd/isa.h"
#include "algo/soa/soa_block.h"
#include "common/opaque.h"

namespace hord::algo {

enum class SoaUse : std::uint8_t {
    sums,      // sums and moments only
    shares,    // also h, an array per bin
    roots,     // also the square roots of h
    marginals  // also the cumulative marginals: I-1 arrays along x, then J-1 along y; all count as lit
};

class SoaRow {
  public:
    static constexpr int kLanes = SoaBlock::kLanes;  // lenslets of a block
    static constexpr int kPad = 16;                  // zeros before the first lenslet and after the last
    static constexpr int kMaxBlock = 1 << 20;

    // `moments` false: moments are 0 and decoding is faster.
    SoaRow(const Extents& extents, SoaUse use, Isa isa, bool moments = true);

    // Decodes lenslet row n of a checked frame: blocks first to last, those of them that exist. The others are then as
    // if all their lenslets were dark.
    void decode(const FrameView& frame, const LightLevels& levels, int n, int first = 0, int last = kMaxBlock);

    [[nodiscard]] int blocks() const { return blocks_; }
    // Array k, from lenslet 0 on; 0 for lenslets without a HORD.
    [[nodiscard]] const float* array(int k) const {
        return values_.data() + static_cast<std::size_t>(k) * stride_ + kPad;
    }

    [[nodiscard]] std::size_t stride() const { return stride_; }  // floats from an array to the next

    // Bit k: array k is not 0 everywhere in the block.
    using Lit = SoaBlock::Lit;
    [[nodiscard]] const Lit& lit(int block) const { return lit_[static_cast<std::size_t>(block)]; }

    // One value per lenslet, padded to whole blocks.
    [[nodiscard]] const std::vector<std::uint32_t>& sums() const { return sums_; }
    [[nodiscard]] const std::vector<std::int32_t>& moments_x() const { return moments_x_; }  // half bins times DN
    [[nodiscard]] const std::vector<std::int32_t>& moments_y() const { return moments_y_; }
    [[nodiscard]] const std::vector<std::uint8_t>& mask() const { return mask_; }
    [[nodiscard]] bool has_hord(int m) const { return mask_[static_cast<std::size_t>(m)] == kValid; }

  private:
    struct Work;

    template <class Sample>
    void decode_samples(const FrameView& frame, const LightLevels& levels, int n, int first, int last);
    void store_block(int block);
    void clear_block(int block);
    void darken(int block, const Lit& still_lit);

    Extents extents_;
    SoaUse use_;
    SoaBlock::Outputs outputs_;
    int blocks_, arrays_;
    std::size_t stride_;
    AlignedVector<float> values_;
    std::vector<Lit> lit_;
    std::vector<std::uint32_t> sums_;
    std::vector<std::int32_t> moments_x_, moments_y_;
    std::vector<std::uint8_t> mask_;
    common::Opaque<Work> work_;
    SoaBlock::Kernels kernels_;
};

inline void unite(SoaRow::Lit& all, const SoaRow::Lit& more) {
    for (std::size_t w = 0; w < all.size(); ++w) all[w] |= more[w];
}

}  // namespace hord::algo
