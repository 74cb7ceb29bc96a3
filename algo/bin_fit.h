// What explains how a lenslet's bins differ from its golden HORD: light that is shifted, light that is scattered, and a rest.
//
// With the golden shares g and the light n that the lenslet has, n g is expected in the bins. r = mass - n g is explained by weighted least squares as
//
//     r = n (a G_x + b G_y + c G_s) + rest       weights 1 / variance of the bin
//
// G_x, G_y: what a shift of the light by one bin changes (central differences of g). G_s: what scattering all of it changes (by the
// binomial 1 4 6 4 1 along each axis, whose variance is one bin squared). algo/compare.h says what the numbers mean, and where the variances come from.
//
// One reading is no bend. Dark bins count with little noise, for most of them read nothing: one that does, beside a spot, looks like a bend of five standard deviations.
// So where a fit says more than kNotable, the largest reading of a dark bin counts as much as the second largest, and the bend is fitted again: light that
// is bent is missing where it was.
//
// Where the work is. Only around the golden HORD's light there is anything to fit: a window of blocks of eight bins, one a row of bins where the
// light is narrow, else one after the other. Bins outside it, and those inside where nothing is expected, count in chi-square alone. Four lenslets are worked on
// step by step together, so that no step waits for what the one before has just written. Narrow light, most of it, has planes of its own (NarrowRows): the window's
// bins alone are brought there, those outside are only squared.
//
// Formats. Floats, eight bins side by side, summed lane by lane in a fixed order, finished in double: the same bits on every instruction set.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "algo/golden_reader.h"
#include "algo/isa.h"
#include "algo/light_field.h"
#include "algo/reference.h"

namespace hord::algo {

struct BinNoise {
    float a_dn = 0;   // variance a DN of light
    float lit = 0;    // more of it in a lit bin
    float soft = 0;   // DN, about where a bin is lit
    float empty = 0;  // variance that a dark bin counts with in the fit
    float quiet = 0;  // that it has
};

// Where a lenslet's samples are, and what is still to be subtracted from them. Sixteen may be read from the start of each line, and the two before it.
struct LensletSamples {
    const void* first = nullptr;
    std::ptrdiff_t line_stride = 0;  // samples
    bool wide = false;               // uint16_t, else uint8_t
    std::uint32_t dark = 0;
};

class BinFitter {
  public:
    static constexpr int kAtOnce = 4;
    static constexpr double kNotable = 3;  // standard deviations by noise alone

    // For golden bins of a Reference's `stride`. Takes all memory.
    BinFitter(const Extents& extents, std::size_t stride, Isa isa);
    BinFitter(BinFitter&&) noexcept = default;
    BinFitter& operator=(BinFitter&&) noexcept = default;

    // The golden HORD of lenslet `slot`: GoldenReader::read_in_row().
    const GoldenReader::Golden& take(int slot, GoldenReader& reader, PoseMap::Place at);
    // And what is compared with it: `light` is n, DN.
    void put(int slot, const LensletSamples& samples, float light, const BinNoise& noise);

    struct Fit {
        bool found = false;  // the bins can be told apart by the three; else nothing else is set
        double a = 0, b = 0, c = 0;
        double a_variance = 0, b_variance = 0, c_variance = 0;
        double chi2 = 0, degrees = 1;  // of the rest, with the whole reading noise in dark bins; what noise alone would give
    };
    // Fits the first `count` slots.
    void fit(int count, std::array<Fit, kAtOnce>& fits);

    // The bins of a slot after its fit: their mass and the golden ones, as Reference::place has them.
    struct Bins {
        const float *mass, *golden;
    };
    Bins bins_of(int slot);

    // Places that are worked on, eight at a time: block b covers first + b step and the seven that follow.
    struct Window {
        int first = 0, step = 0, blocks = 0;
    };
    // Room before the first bin and after the last: two rows and two bins of the largest HORDs, and two blocks.
    static constexpr int kLanes = 8, kRoom = 64, kPlaces = 304 + 2 * kRoom;
    static_assert(kRoom >= 2 * (kMaxBins + 2) + 2 + 2 * kLanes && kPlaces - 2 * kRoom >= (kMaxBins + 2) * (kMaxBins + 2));
    struct Planes {
        alignas(64) float golden[kPlaces], scattered[kPlaces], half[kPlaces], mass[kPlaces];
    };
    static_assert(kPlaces >= NarrowRows::kPlaces);
    struct Slot {
        Planes wide, narrow;               // as Reference::place from kRoom on; NarrowRows
        GoldenReader::Golden at;           // what was read
        GoldenLines written;               // of wide.golden
        int half_first = 0, half_end = 0;  // of wide.half
        bool narrow_window = false;        // which planes are worked on
        int lit_rows = 0;                  // of a narrow window
        const std::int32_t* here = nullptr;  // of the first block of a wide window; of each of a narrow one
        Window window;
        float bins = 0;                    // of the window
        float dark = 0;                    // squares outside it, of a narrow one
        BinNoise noise;
        float light;
        LensletSamples samples;
    };
    // Sums over bins, of each slot: products of residual r and templates x, y, b (for blur), each over the bin's variance.
    enum Sum : std::uint8_t { rx, ry, rb, xx, xy, xb, yy, yb, bb, kSums };
    struct Solution {
        double a[kAtOnce], b[kAtOnce], c[kAtOnce];           // in DN
        double c_xx[kAtOnce], c_yy[kAtOnce], c_bb[kAtOnce];  // the diagonal of the inverse
        std::int64_t found[kAtOnce];
    };
    struct Rest {
        double chi2[kAtOnce], dark[kAtOnce], narrowed[kAtOnce];
    };
    struct Layout {
        const std::int32_t* here;  // -1 where there is a bin, else 0
        int columns, rows, pitch;
        int first_block, last_block;  // that have bins
    };
    // Which bins a narrow window has.
    struct Rows {
        int first, last;              // rows of bins
        int left;                     // bin of the first of eight places, -2 and above
        const std::uint16_t* beside;  // of sixteen bins of a line: all ones where it is beside the window
    };

  private:
    [[nodiscard]] Window window_of(const LitPlaces& lit) const;
    struct Reading {
        float* mass = nullptr;  // of a bin, and what it
        float was = 0;
    };
    Reading limit_largest_dark(Slot& slot) const;

    int columns_, rows_, pitch_, blocks_;
    std::vector<std::int32_t> here_;
    std::vector<Slot> slots_;
    Layout layout_{};
    std::vector<std::int32_t> here_narrow_;  // eight for each column where light may begin
    std::vector<std::uint16_t> beside_;      // sixteen for each

    void (*spread_out_)(const LensletSamples& samples, const Layout& layout, float* out);
    float (*take_rows_)(const LensletSamples& samples, const Layout& layout, const Rows& rows, float* out);
    void (*scatter_)(Slot* slots, int count, const Layout& layout);
    void (*solve_)(const Slot* slots, int count, const Layout& layout, Solution& out);
    void (*look_at_rest_)(Slot* slots, int count, const Layout& layout, const Solution& solution, Rest& out);
};

}  // namespace hord::algo
