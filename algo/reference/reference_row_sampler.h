// The reference HORDs along a row of a part, sixteen lenslets side by side: the same bin of neighbouring lenslets lies
// together, so that one instruction works on as many lenslets as it has lanes.
//
// A part's row lies on a straight line in the reference, its lenslets all but a lenslet apart. Every column of the
// reference is interpolated once where the line crosses it (a cubic of the four lenslets above and below), and a
// lenslet between four such columns along the line (another cubic). Columns come in blocks of sixteen, and with a block
// the lenslets whose four columns begin in it.
//
// ReferenceSoa is the reference stored for that, made once: of every row and block of columns the bins that have light
// there or up to four rows away, column by column, as floats. At the paper's size 56 MB; threads share it.
//
// Formats. Shares are Q0.15 below 1, cubic weights Q1.7: the sum over four lenslets stays below 1.25 * 2^7 * 2^15 <
// 2^23, exact as floats in whatever order. Then floats, lane by lane: the same bits on every instruction set.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "algo/reference/pose.h"
#include "algo/reference/reference.h"
#include "algo/simd/isa.h"

namespace hord::algo {

// Some columns and rows of bins, the last ones included; by default none.
struct BinRect {
    std::int16_t left = 0, right = -1, top = 0, bottom = -1;

    [[nodiscard]] bool none() const { return right < left; }
    [[nodiscard]] int columns() const { return right - left + 1; }
    [[nodiscard]] int rows() const { return bottom - top + 1; }
    [[nodiscard]] bool has(int i, int j) const { return i >= left && i <= right && j >= top && j <= bottom; }
    [[nodiscard]] bool has(const BinRect& r) const {
        return r.none() || (has(r.left, r.top) && has(r.right, r.bottom));
    }
    void cover(const BinRect& r) {
        if (r.none()) return;
        if (none()) *this = r;
        left = std::min(left, r.left), right = std::max(right, r.right), top = std::min(top, r.top),
        bottom = std::max(bottom, r.bottom);
    }
    friend bool operator==(const BinRect&, const BinRect&) = default;
};

// Lanes that are worked on together, and columns of a block.
inline constexpr int kGoldenLanes = 16;
// Of these an instruction takes so many.
constexpr int lanes_at_once(Isa isa) { return isa == Isa::avx512 ? 16 : isa == Isa::avx2 ? 8 : 4; }

struct alignas(kGoldenLanes * sizeof(float)) LaneLine {
    float of[kGoldenLanes];
};

class ReferenceSoa {
  public:
    static constexpr int kAcross = 4,
                         kRowsTogether = kAcross +
        1;  // a cubic's rows; those that a block's columns may need, where the line is not level

    explicit ReferenceSoa(const Reference& reference);

    struct Block {
        std::uint32_t first = 0;  // of shares, in vectors of sixteen
        BinRect stored;           // these bins, row by row
        BinRect lit;              // with light in this row or one of the four below it
        std::uint16_t plain =
            0;  // columns where this lenslet and the three below it have a reference HORD; bit c: column c
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
    std::vector<LaneLine> light_;
    std::vector<LaneLine> shares_;
};

class ReferenceRowSampler {
  public:
    // Both outlive it.
    ReferenceRowSampler(const Reference& reference, const ReferenceSoa& planes, Isa isa);

    // Begins row n of a part that lies so, at `light` times the reference's light.
    void start_row(const PoseMap& pose, int n, double light);

    // To a block of columns, fastest from left to right. Lane l is then the lenslet between columns 16 block + l and
    // the three that follow, the first of which is beyond it; any block, but those outside the reference have no such
    // lenslets.
    void move_to(int block);
    [[nodiscard]] std::uint32_t plain() const { return plain_; }  // bit l: lane l can be interpolated
    [[nodiscard]] const BinRect& lit() const { return lit_; }     // of the plain ones

    // What lanes_at_once() lanes from `first` on expect.
    struct Lanes {
        alignas(64) float weights[ReferenceSoa::kAcross][kGoldenLanes];  // in: cubic along the row, Q1.7
        alignas(64) float light[kGoldenLanes];                           // out: DN, at the reference's light
        alignas(
            64) float share[kGoldenLanes];  // out: of it the part has, at its light: what the reference bins add up to
    };
    // `out`: the reference bins of `bins`, which has lit(), as shares at the part's light; lane by lane, the next bin
    // so many lanes further, the next row of bins `pitch` bins.
    void interpolate(int first, const BinRect& bins, Lanes& lanes, float* out, int pitch);

    static constexpr int kSides = 2 * kGoldenLanes;  // a block, and the next one
    struct Join {                                    // a block's columns where the line crosses them
        const float* from[ReferenceSoa::kRowsTogether];
        BinRect stored[ReferenceSoa::kRowsTogether];
        int rows = 0;
        alignas(64) float weights[ReferenceSoa::kRowsTogether][kGoldenLanes];
    };
    struct Between {
        const float* columns;  // of bin (0, 0); the next bin is kSides further
        int bin_columns;
        float light, clip_dn;  // the part's over the reference's
    };

  private:
    struct Side {
        int block = kNone;
        std::uint32_t plain = 0;
        BinRect lit, ready;  // bins with light; bins that are written
        Join join;
    };
    static constexpr int kNone = -1000;
    void find(int block, Side& side, int lane);
    void write(const BinRect& bins, Side& side, int lane);

    const Reference& reference_;
    const ReferenceSoa& planes_;
    double line_m_ = 0, line_n_ = 0, line_slope_ = 0, row_light_ = 1;  // a place on the row's line, and how it falls
    Side here_, next_;
    std::uint32_t plain_ = 0;
    BinRect lit_;
    std::vector<LaneLine> columns_;  // two a bin: of the block and of the next, sums in Q0.15 times Q1.7
    alignas(64) float light_[kSides] = {};

    void (*join_)(const Join& join, const BinRect& bins, const BinRect& lit, int bin_columns, float* out);
    void (*interpolate_)(const Between& between, int first, const BinRect& bins, const float* light, Lanes& lanes,
                         float* out, int pitch);
};

// Cubic weights as integers in 1/128 which sum to 128, of a place `t` (0..1) after the second of four, to a 1024th.
struct QuantisedCubic {
    std::int16_t of[4];
};
QuantisedCubic quantised(const CubicWeights& weights);
const QuantisedCubic& cubic_at(double t);

}  // namespace hord::algo
