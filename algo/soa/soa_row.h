// A row of lenslets stored bin by bin: the same bin of neighbouring lenslets lies side by side, so that sixteen
// lenslets are worked on at once. Most bins are dark in all of sixteen neighbouring lenslets: those are neither stored
// nor looked at.
//
// Masses, sums and moments are the integers of algo/frame/decode.h, exact. `share` values are floats: h = mass / sum
// (Eq. 8), or its root; each is wrong by less than 2^-22 of itself (a mass and a sum are below 2^24 and so exact
// floats; reciprocal, product and root each round by 2^-24 at most). Everything is computed lane by lane in a fixed
// order: the same bits on every instruction set.
//
// Test: tests/algo/soa/soa_distances_test.cpp.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "algo/frame/decode.h"
#include "algo/simd/aligned.h"
#include "algo/simd/isa.h"
#include "algo/soa/soa_block.h"

namespace hord::algo {

enum class SoaUse : std::uint8_t {
    sums,      // sums and moments only
    shares,    // and h in planes
    roots,     // and its roots in planes
    marginals  // and the cumulative marginals in planes: I-1 along x, then J-1 along y; all count as lit
};

class SoaRow {
  public:
    static constexpr int kLanes = SoaBlock::kLanes;  // lenslets of a block
    static constexpr int kPad = 16;                  // floats before the first lenslet and after the last, always 0

    // Without `moments` they are all 0, and decoding is faster.
    SoaRow(const Extents& extents, SoaUse use, Isa isa, bool moments = true);
    SoaRow(SoaRow&&) noexcept;
    ~SoaRow();

    // Decodes lenslet row n of a checked frame.
    void decode(const FrameView& frame, const LightLevels& levels, int n);

    // The same from HORDs that are there already; sum 0: none.
    void take(std::span<const Hord> row);

    [[nodiscard]] int blocks() const { return blocks_; }
    [[nodiscard]] int planes() const { return planes_; }
    // The value of plane k for lenslet 0; the others follow. 0 for lenslets without a HORD.
    [[nodiscard]] const float* plane(int k) const {
        return planes_of_.data() + static_cast<std::size_t>(k) * stride_ + kPad;
    }

    // Planes that are not 0 in all lenslets of a block.
    using Lit = SoaBlock::Lit;
    [[nodiscard]] const Lit& lit(int block) const { return lit_[static_cast<std::size_t>(block)]; }

    // One value a lenslet (and some more, to a whole number of blocks).
    [[nodiscard]] const std::vector<std::uint32_t>& sums() const { return sums_; }
    [[nodiscard]] const std::vector<std::int32_t>& moments_x() const { return moments_x_; }  // half bins times DN
    [[nodiscard]] const std::vector<std::int32_t>& moments_y() const { return moments_y_; }
    [[nodiscard]] const std::vector<std::uint8_t>& mask() const { return mask_; }
    [[nodiscard]] bool has_hord(int m) const { return mask_[static_cast<std::size_t>(m)] == kValid; }

  private:
    struct Work;

    template <class Sample>
    void decode_samples(const FrameView& frame, const LightLevels& levels, int n);
    void store_block(int block);

    Extents extents_;
    SoaUse use_;
    SoaBlock::Wanted wanted_;
    int blocks_, planes_;
    std::size_t stride_;
    AlignedVector<float> planes_of_;
    std::vector<Lit> lit_;
    std::vector<std::uint32_t> sums_;
    std::vector<std::int32_t> moments_x_, moments_y_;
    std::vector<std::uint8_t> mask_;
    std::unique_ptr<Work> work_;
    SoaBlock::Gather<std::uint8_t> gather8_;
    SoaBlock::Gather<std::uint16_t> gather16_;
    SoaBlock::Shares shares_;
    SoaBlock::Marginals marginals_;
};

}  // namespace hord::algo
