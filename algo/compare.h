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
// Variances. A bin of n g DN varies by n g / electrons_per_dn + read^2 + 1/12, and the golden one by 1/parts of that. Each of the four
// divided by its expected standard deviation, with the good parts' own spread added, is a z-score: about normal for good parts at any light.
//
// Formats. Shares are Q0.15, cubic weights products of two Q1.7, so their sum over 4x4 stays below 1.25^2 * 2^14 * 2^15 < 2^30 (int32, exact);
// then floats, sixteen bins side by side, summed lane by lane in a fixed order, finished in double: the same bits on every instruction set.
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

class Comparer {
  public:
    // `reference` outlives it. Takes all memory.
    explicit Comparer(const Reference& reference, Isa isa = best_isa());

    // Compares row n of a part: `light` is its typical sum over the reference's. One Difference a lenslet.
    void compare_row(const HordRow& row, int n, const PoseMap& pose, double light, std::span<Difference> out);

    struct Templates;  // sums over bins, compare.cpp
    struct Taps {
        const std::uint16_t* from[16];
        std::int16_t weights[16];
        int count;
        float light, clip;  // the part's over the reference's; of the lenslet's light
    };
    struct Bins {
        const float *golden, *scattered, *mass, *here;
        int blocks, row;                  // sixteen bins each; from a bin to the one below
        float light, inverse_gain, floor;  // DN; variance a DN; variance of an empty bin
    };

  private:
    bool interpolate(double m, double n, double light, float& expected, std::uint8_t& bits);
    void compare(const HordRow& row, int m, int n, const PoseMap& pose, double light, Difference& out);

    const Reference& reference_;
    struct Lit {
        std::uint8_t first, last;  // blocks of sixteen shares: those with light, and those they touch
    };
    int padded_i_, blocks_;
    std::vector<Lit> lit_;                     // one a lenslet
    std::vector<float> golden_, scattered_, half_, other_half_, mass_, here_;  // as Reference::place has it, with room on either side; 1 where there is a bin
    Lit around_{};                             // of the golden HORD that was interpolated last
    float share_ = 1;                          // and the sum of its shares at the part's light
    double clipped_ = 0;                       // of a typical lenslet's light, by the dark level
    float (*gather_)(const Taps& taps, int blocks, int first, int last, float* out);
    void (*scatter_)(const float* golden, int blocks, int row, float* half, float* other_half, float* out);
    void (*spread_out_)(const std::uint16_t* masses, int columns, int rows, float* out);
    void (*project_)(const Bins& bins, int first, int last, Templates& out);
};

// The four scores of a lenslet: deviation over its standard deviation. Light and blur are signed (less light, less spread: negative).
using Scores = std::array<float, kDeviations>;
Scores scores_of(const Difference& difference, const Reference& reference);

}  // namespace hord::algo
