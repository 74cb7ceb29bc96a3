// The golden HORD at a place between the reference's lenslets, at the light that a part has: by cubic interpolation of the 4x4 lenslets around it,
// of fewer where some have none.
//
// Row by row. The lenslets of a part's row lie on a straight line in the reference, all but a lenslet apart. Every column of the reference is interpolated once where
// that line crosses it, and a lenslet between four such columns along the line: two cubics of four instead of one of sixteen.
//
// Another light. The dark level cuts `clip` DN off every lit bin, whatever its light. A part with s times the reference's light G = n g has
// s (G + clip) - clip; bins with less than clip in proportion: s G - (1 - s) min(clip, G).
//
// Formats. Shares are Q0.15 below 1, cubic weights Q1.7. Of a column, the sum over four stays below 1.25 * 2^7 * 2^15 < 2^23 (int32, and exact as a float); of 4x4 at
// once, with products of two weights, below 1.25^2 * 2^14 * 2^15 < 2^30 (int32, exact). Then floats, lane by lane: the same bits on every instruction set.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "algo/isa.h"
#include "algo/pose.h"
#include "algo/reference.h"

namespace hord::algo {

// Where a golden HORD has light: places as Reference::place, and their columns and rows, the border's bins counted.
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
        const auto p = static_cast<std::int16_t>(place), c = static_cast<std::int16_t>(column), r = static_cast<std::int16_t>(row);
        const auto minus = [](std::int16_t v) { return static_cast<std::int16_t>(-v); };
        LitPlaces lit;
        lit.most_ = Most{minus(p), p, minus(c), c, minus(r), r, 0, 0};
        return lit;
    }
};

// Lines of sixteen places, the last one not beyond a Reference's stride.
struct GoldenLines {
    static constexpr int kLine = 16;
    int first = 0, count = 0;
    [[nodiscard]] int end() const { return first + count * kLine; }
};

// Bins of a HORD whose light lies in four columns at most: of each row eight places, from two left of the light on, sixteen from row to row; what is between
// is 0. The first row with light is row kTop, and rows that have none, kTop of them, follow the last. Only where the light begins in a HORD's first columns: what
// is compared with those eight places then lies within sixteen samples.
struct NarrowRows {
    static constexpr int kPitch = 16, kFirst = 4, kTop = 4, kRows = 24, kMostColumns = 4, kMostLeft = 11, kPlaces = kPitch * kRows;
    static_assert(kRows >= kMaxBins + 2 * kTop);
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
        bool narrow = false;   // what was written are narrow rows instead, one for each row with light
    };

    // `reference` outlives it.
    GoldenReader(const Reference& reference, Isa isa);
    GoldenReader(GoldenReader&&) noexcept = default;  // its columns point into its own memory: it is not copied
    GoldenReader& operator=(GoldenReader&&) = delete;

    // At a place of the reference, lenslets. `bins` receives lines of golden bins, as shares at `light` times the reference's light; the rest of it is left
    // alone. There is room for a Reference's stride.
    Golden read(double m, double n, double light, float* bins) const;

    // Begins row n of a part that lies so, at so much light.
    void start_row(const PoseMap& pose, int n, double light);
    // The same as read() of a place on that row's line, all but rounding, and the interpolation along it; fastest from left to right. Where the light is narrow,
    // `narrow` (NarrowRows::kPlaces) receives it instead of `bins`.
    void read_in_row(PoseMap::Place at, float* bins, float* narrow, Golden& golden);

    struct Taps {
        const std::uint16_t* from[16];
        alignas(32) std::int16_t weights[16];  // 0 where there is none; Q1.14
        float light, clip;                     // the part's over the reference's; of the lenslet's light
    };
    struct Between {
        const float* from[4];  // of each column the first bin that is read
        float weights[4];      // and what makes shares of it
        float light, clip;
    };

  private:
    const Reference& reference_;
    std::vector<LitPlaces> lit_;             // one a lenslet
    std::vector<LitPlaces> lit_of_four_;     // of the four below one another that a lenslet begins
    std::vector<std::uint8_t> plain_;        // whether they all have a golden HORD

    // A column of the reference where the row's line crosses it.
    struct Column {
        int m = kNone;
        bool plain = false;
        LitPlaces lit;
        GoldenLines written;
        float light = 0;        // Q1.7
        float* bins = nullptr;  // Q0.15 times Q1.7
    };
    static constexpr int kColumns = 8, kNone = -1000;  // columns that are remembered
    const Column& column(int m) {
        Column& c = columns_[static_cast<std::size_t>(m + kColumns) % kColumns];
        if (c.m != m) join_column(m, c);
        return c;
    }
    void join_column(int m, Column& out);
    std::vector<float> column_bins_;
    std::array<Column, kColumns> columns_;
    double line_m_ = 0, line_n_ = 0, line_slope_ = 0, row_light_ = 1;  // of the row at hand: a place on the line, and how it falls

    float (*gather_)(const Taps& taps, GoldenLines lines, float* out);
    void (*join_)(const std::uint16_t* const (&from)[4], const std::int16_t* weights, GoldenLines lines, float* out);
    float (*along_lines_)(const Between& between, GoldenLines lines, float* out);
    float (*along_rows_)(const Between& between, int rows, int pitch, float* out);
};

}  // namespace hord::algo
