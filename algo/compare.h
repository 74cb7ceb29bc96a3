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
// Variances. A bin that expects e = n g DN had e + clip before the dark level was cut off, and varies by (e + clip) / electrons_per_dn +
// read^2 + 1/12. One that expects nothing reads nothing unless its noise exceeds the clip: the variance of what a normal number has above it, far
// less; in the fit it counts with a sixteenth of the reading noise at least, for single readings are not normal, and within
// two lenslets of an edge with all of it, for interpolation puts light there that is none. In between it is mixed by e / (e + soft), soft
// one standard deviation of the reading. The golden bin's own variance is 1/parts of the photon noise. Each of the four deviations, divided by
// its expected standard deviation, with the good parts' own spread added, is a z-score: about normal for good parts at any light, less in the spread.
//
// Chi-square is that of the rest with the whole reading noise in dark bins, too. Where it is much (kMuch), a fit of small shifts does not say how far light went:
// where the mean of all bins moved by more than kFarBins beyond what the reference's does from neighbour to neighbour, that is the bend.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "algo/bin_fit.h"
#include "algo/decode.h"
#include "algo/golden_reader.h"
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
    // kOutside are not looked at: their Difference stays as it is.
    void compare_row(const FrameView& frame, std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, int n, const PoseMap& pose, double light,
                     std::span<Difference> out);

  private:
    struct Waiting {          // a lenslet whose bins are still to be fitted, with others
        Difference* out = nullptr;
        double x = 0, y = 0;  // by how much the part's turn changes the reference's deflection there
    };
    void start_row(const PoseMap& pose, int n, double light);
    template <class Sample>
    LensletSamples copy_of(const Sample& sample, std::uint32_t dark);
    void compare(const LensletSamples& samples, std::uint32_t sum, bool has_hord, int m, int n, Difference& out);
    void finish_waiting();
    void look_how_far(int slot, Difference& out);
    void find_edges();
    [[nodiscard]] BinNoise at_light(const BinNoise& noise) const;

    const Reference& reference_;
    GoldenReader golden_;
    BinFitter fitter_;
    std::vector<std::uint8_t> edge_;           // one a lenslet: whether it is within two lenslets of an edge
    std::vector<std::uint16_t> copied_;        // of lenslets at the end of the frame's lines, one a slot
    double clipped_ = 0;                       // of a typical lenslet's light, by the dark level
    double floor_ = 0;                         // variance of a reading
    BinNoise noise_{}, noise_at_edges_{};

    // Of the row at hand.
    const PoseMap* pose_ = nullptr;
    double light_ = 1, golden_share_ = 1;
    BinNoise noise_now_{}, noise_at_edges_now_{};
    std::array<Waiting, BinFitter::kAtOnce> waiting_{};
    int waiting_count_ = 0;
};

// The four scores of a lenslet: deviation over its standard deviation. Light and blur are signed (less light, less spread: negative).
using Scores = std::array<float, kDeviations>;
Scores scores_of(const Difference& difference, const Reference& reference);

}  // namespace hord::algo
