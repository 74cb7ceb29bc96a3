// How a lenslet differs from the golden HORD of its place, told apart and in units of noise.
//
// With the golden shares g at the place where the registered part has this lenslet (cubic interpolation between golden HORDs) and n the light
// that the lenslet has, n g is expected in the bins. What remains, r = mass - n g, is explained by weighted least squares as
//
//     r = n (a G_x + b G_y + c G_s) + rest       weights 1 / variance of the bin
//
// G_x, G_y: what a shift of the light by one bin changes (central differences of g). G_s: what scattering all of it changes (by the
// binomial 1 4 6 4 1 along each axis, whose variance is one bin squared), so that c is the share of the light that is scattered, and by how
// much the variance along each axis grows. So a, b are the change of the mean deflection, c that of the spread, and neither disturbs the
// other; the rest is chi-square. Scattered light falls mostly into bins that were dark, where interpolation errs little: that is why c
// is seen on steep parts, too. Missing light is judged apart: n over what the reference has, at the part's typical light.
//
// Another light. The dark level cuts `clip` DN off every lit bin, whatever its light. A part with s times the reference's light G = n g has
// s (G + clip) - clip; bins with less than clip in proportion: s G - (1 - s) min(clip, G).
//
// Variances. A bin that expects e = n g DN had e + clip before the dark level was cut off, and varies by (e + clip) / electrons_per_dn +
// read^2 + 1/12. One that expects nothing reads nothing unless its noise exceeds the clip: the variance of what a normal number has above it, far
// less; in the fit it counts with a sixteenth of the reading noise at least, for single readings are not normal, and within
// two lenslets of an edge with all of it, for interpolation puts light there that is none. In between it is mixed by e / (e + soft), soft
// one standard deviation of the reading. The golden bin's own variance is 1/parts of the photon noise. Each of the four deviations, divided by
// its expected standard deviation, with the good parts' own spread added, is a z-score: about normal for good parts at any light, less in the spread.
//
// Chi-square is that of the rest with the whole reading noise in dark bins, too. Where it is much (kMuch), a fit of small shifts does not say how far light went:
// where the mean of all bins moved by more than kFarBins beyond what the reference's does from neighbour to neighbour, that is the bend.
//
// Formats. Shares are Q0.15 below 1, cubic weights products of two Q1.7, so their sum over 4x4 stays below 1.25^2 * 2^14 * 2^15 < 2^30 (int32, exact);
// then floats, eight bins side by side, summed lane by lane in a fixed order, finished in double: the same bits on every instruction set.
#pragma once

#include <cstdint>
#include <span>

#include "algo/decode.h"
#include "algo/isa.h"
#include "algo/pose.h"
#include "algo/reference.h"

namespace hord::algo {

// Of one lenslet. Deviations in their units and their variance by noise alone.
struct Difference {
    bool has_light = false;  // the first two mean something: the reference knows how much light there should be
    bool has_hord = false;   // and so do the others
    float light = 0, light_variance = 1;  // light / expected - 1
    float x = 0, y = 0, x_variance = 1, y_variance = 1;
    float blur = 0, blur_variance = 1;
    float chi2 = 0, degrees = 1;          // the rest, and what noise alone would give
    float sum = 0;                        // DN
    std::uint32_t at = 0;                 // the reference's nearest lenslet
};

constexpr float kMuch = 3;  // standard deviations
constexpr double kFarBins = 0.5;

class Comparer {
  public:
    // `reference` outlives it. Takes all memory.
    explicit Comparer(const Reference& reference, Isa isa = best_isa());

    // Compares row n of a part: `light` is its typical sum over the reference's. One Difference a lenslet.
    void compare_row(const HordRow& row, int n, const PoseMap& pose, double light, std::span<Difference> out);
    // The same from the frame that was decoded with the reference's light levels, when the lenslets' sums and masks are known already. Those that are
    // kOutside are not looked at: their Difference has nothing.
    void compare_row(const FrameView& frame, std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, int n, const PoseMap& pose, double light,
                     std::span<Difference> out);

    struct Templates;  // sums over bins, compare.cpp
    struct Rest;
    struct Taps {
        const std::uint16_t* from[16];
        std::int16_t weights[16];  // 0 where there is none; Q1.14
        float light, clip;         // the part's over the reference's; of the lenslet's light
    };
    struct Noise {
        float a_dn;    // variance a DN of light
        float lit;     // more of it in a lit bin
        float soft;    // DN, about where a bin is lit
        float empty;   // variance that a dark bin counts with in the fit
        float quiet;   // that it has
    };
    struct Bins {
        const float *golden, *scattered, *mass, *here;
        int blocks, row;  // eight bins each; from a bin to the one below
        float light;      // DN
        Noise noise;
    };

  private:
    struct Lit {
        std::uint16_t first, last;  // shares: those with light
    };
    struct Lenslet {
        const void* samples;  // of its bins, sixteen a line may be read
        std::ptrdiff_t line_stride;
        bool wide;            // uint16_t, else uint8_t
        std::uint32_t dark;   // still to be subtracted
        std::uint32_t sum;
        bool has_hord;
    };
    bool interpolate(double m, double n, double light, float& expected, std::uint8_t& bits);
    void compare(const Lenslet& lenslet, int m, int n, const PoseMap& pose, double light, Difference& out);
    void find_edges();
    void look_how_far(const Bins& bins, Difference& out) const;

    const Reference& reference_;
    int padded_i_, blocks_;
    std::vector<Lit> lit_;                     // one a lenslet
    std::vector<Lit> lit_of_sixteen_;          // of the 4x4 that a lenslet begins
    std::vector<std::uint8_t> plain_;          // whether they all have a golden HORD
    std::vector<std::uint8_t> edge_;           // whether it is within two lenslets of an edge
    std::vector<float> golden_, scattered_, half_, mass_, here_;  // as Reference::place has it, with room on either side; 1 where there is a bin
    std::vector<std::uint16_t> copied_;        // of a lenslet at the end of the frame's lines
    Noise noise_{}, noise_at_edges_{};
    struct Blocks {
        int first, last;  // of eight shares
    } around_{};                               // of the golden HORD that was interpolated last: with what scattering reaches
    Lit lit_now_{};                            // and where its light is
    float share_ = 1;                          // and the sum of its shares at the part's light
    double clipped_ = 0;                       // of a typical lenslet's light, by the dark level
    float (*gather_)(const Taps& taps, int first, int last, float* out);
    void (*scatter_)(const float* golden, int first, int last, int lit_first, int lit_last, int row, float* half, float* out);
    void (*spread_out_)(const void* samples, std::ptrdiff_t line_stride, bool wide, std::uint32_t dark, int columns, int rows, float* out);
    void (*project_)(const Bins& bins, int first, int last, Templates& out);
    void (*look_at_rest_)(const Bins& bins, int first, int last, float a, float b, float c, Rest& out);
};

// The four scores of a lenslet: deviation over its standard deviation. Light and blur are signed (less light, less spread: negative).
using Scores = std::array<float, kDeviations>;
Scores scores_of(const Difference& difference, const Reference& reference);

}  // namespace hord::algo
