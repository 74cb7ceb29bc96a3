// The reference HORDs along a row of a part, sixteen lenslets at a time, in the SoA layout (the same bin of
// neighbouring lenslets is contiguous): cubic interpolation between rows, then between columns. Columns are processed
// in blocks of sixteen; a lenslet belongs to the block in which its four columns begin. docs/notes/reference.md.
//
// ReferenceSoa is the reference in that layout, made once: for every row and block of columns the bins that have light
// there or up to four rows away, as floats. 56 MB at the paper's size; threads share it.
//
// Formats. Shares are Q0.15 below 1, cubic weights Q1.7: the sum over four lenslets stays below 2^23 and is exact in
// floats, in any order. Then floats, lane by lane: the same bits on every instruction set.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/reference/pose.h"
#include "algo/reference/reference.h"
#include "algo/simd/isa.h"

namespace hord::algo {

// Lenslets that are compared together, and columns of a block.
inline constexpr int kReferenceLanes = 16;
// Floats in a vector of an instruction set.
constexpr int lanes_at_once(Isa isa) { return isa == Isa::avx512 ? 16 : isa == Isa::avx2 ? 8 : 4; }

struct alignas(kReferenceLanes * sizeof(float)) LaneFloats {
    float of[kReferenceLanes];
};

class ReferenceSoa {
  public:
    static constexpr int kCubicRows = 4;             // of an interpolation
    static constexpr int kMaxRows = kCubicRows + 1;  // of all columns of a block, where the line is not horizontal

    explicit ReferenceSoa(const Reference& reference);

    struct Block {
        std::uint32_t first = 0;  // index of its shares, in vectors of sixteen
        BinRect stored;           // the bins stored, row by row
        BinRect lit;              // bins with light in this row or one of the four below it
        // Bit c: in column c, this lenslet and the three below it have a reference HORD.
        std::uint16_t complete = 0;
    };
    [[nodiscard]] int blocks() const { return blocks_; }
    [[nodiscard]] const Block& block(int row, int block) const { return blocks_of_[index(row, block)]; }
    [[nodiscard]] const float* shares(const Block& block) const { return shares_[block.first].of; }
    [[nodiscard]] const float* light(int row, int block) const { return light_[index(row, block)].of; }  // DN

  private:
    [[nodiscard]] std::size_t index(int row, int block) const {
        return static_cast<std::size_t>(row) * static_cast<std::size_t>(blocks_) + static_cast<std::size_t>(block);
    }
    int blocks_;
    std::vector<Block> blocks_of_;
    std::vector<LaneFloats> light_;
    std::vector<LaneFloats> shares_;
};

class ReferenceRowSampler {
  public:
    // `reference` and `soa` outlive it.
    ReferenceRowSampler(const Reference& reference, const ReferenceSoa& soa, Isa isa);

    // Begins row n of a part with this pose, at `light` times the reference's light.
    void start_row(const PoseMap& pose, int n, double light);

    // Moves to a block of columns; fastest from left to right. Lane l is the lenslet between the second and the third
    // of the columns 16 block + l and the three that follow. Blocks outside the reference are allowed: no lane is
    // complete.
    void move_to(int block);
    [[nodiscard]] std::uint32_t complete() const { return complete_; }  // bit l: lane l can be interpolated
    [[nodiscard]] const BinRect& lit() const { return lit_; }           // bins with light in the complete lanes

    // Weights and results of lanes_at_once() lanes from `first` on.
    struct Lanes {
        alignas(64) float weights[ReferenceSoa::kCubicRows][kReferenceLanes];  // in: cubic along the row, Q1.7
        alignas(64) float light[kReferenceLanes];                              // out: DN, at the reference's light
        alignas(64) float share[kReferenceLanes];  // out: sum of the reference bins, at the part's light
    };
    // Writes the reference bins of `bins`, which contains lit(), to `out`, as shares at the part's light:
    // lanes_at_once() lanes of a bin, then the next bin; rows of bins are `pitch` bins apart.
    void interpolate(int first, const BinRect& bins, Lanes& lanes, float* out, int pitch);

    static constexpr int kBlockPair = 2 * kReferenceLanes;  // lanes of a block and the next one
    struct RowTaps {                                        // input of the interpolation between rows
        const float* from[ReferenceSoa::kMaxRows];
        BinRect stored[ReferenceSoa::kMaxRows];
        int rows = 0;
        alignas(64) float weights[ReferenceSoa::kMaxRows][kReferenceLanes];
    };
    struct ColumnTaps {        // input of the interpolation between columns
        const float* columns;  // of bin (0, 0); the next bin is kBlockPair further
        int bin_columns;
        float light, clip_dn;  // the part's over the reference's
    };

  private:
    struct ColumnBlock {
        int block = kNone;
        std::uint32_t complete = 0;
        BinRect lit, ready;  // bins with light; bins that are interpolated already
        RowTaps taps;
    };
    static constexpr int kNone = -1000;
    void set_up(int block, ColumnBlock& columns, int lane);
    void interpolate_rows(const BinRect& bins, ColumnBlock& columns, int lane);

    const Reference& reference_;
    const ReferenceSoa& soa_;
    double line_m_ = 0, line_n_ = 0, line_slope_ = 0, row_light_ = 1;  // a point of the row's line, and its slope
    ColumnBlock here_, next_;
    std::uint32_t complete_ = 0;
    BinRect lit_;
    std::vector<LaneFloats> columns_;  // two a bin: of the block and of the next one; Q0.15 times Q1.7
    alignas(64) float light_[kBlockPair] = {};

    void (*interpolate_rows_)(const RowTaps& taps, const BinRect& bins, const BinRect& lit, int bin_columns,
                              float* out);
    void (*interpolate_columns_)(const ColumnTaps& taps, int first, const BinRect& bins, const float* light,
                                 Lanes& lanes, float* out, int pitch);
};

// Cubic weights as integers in 1/128 that sum to 128. cubic_at: for a point `t` (0..1) after the second of four
// lenslets, rounded to 1/1024.
struct QuantisedCubic {
    std::int16_t of[4];
};
QuantisedCubic quantised(const CubicWeights& weights);
const QuantisedCubic& cubic_at(double t);

}  // namespace hord::algo
