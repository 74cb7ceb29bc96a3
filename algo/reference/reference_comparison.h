// How a lenslet differs from the reference HORD of its place, told apart and in units of noise.
//
// With the reference shares g at the place where the registered part has this lenslet (cubic interpolation between
// reference HORDs) and n the light that the lenslet has, n g is expected in the bins. What remains, r = mass - n g, is
// explained by weighted least squares as
//
//     r = n (a G_x + b G_y + c G_s) + rest       weights 1 / variance of the bin
//
// G_x, G_y: what a shift of the light by one bin changes (central differences of g). G_s: what scattering all of it
// changes (by the binomial 1 4 6 4 1 along each axis, whose variance is one bin squared), so that c is the share of the
// light that is scattered, and by how much the variance along each axis grows. So a, b are the change of the mean
// deflection, c that of the spread, and neither disturbs the other; the rest is chi-square. Scattered light falls
// mostly into bins that were dark, where interpolation errs little: that is why c is seen on steep parts, too. Missing
// light is judged apart: n over what the reference has, at the part's typical light.
//
// Variances. A bin that expects e = n g DN had e + clip before the dark level was cut off, and varies by (e + clip) /
// electrons_per_dn + read^2 + 1/12. One that expects nothing reads nothing unless its noise exceeds the clip: the
// variance of what a normal number has above it, far less; in the fit it counts with a sixteenth of the reading noise
// at least, for single readings are not normal, and within two lenslets of an edge with all of it, for interpolation
// puts light there that is none. In between it is mixed by e / (e + soft), soft one standard deviation of the reading.
// The reference bin's own variance is 1/parts of the photon noise. Each of the four deviations, divided by its expected
// standard deviation, with the good parts' own spread added, is a z-score: about normal for good parts at any light,
// less in the spread.
//
// Chi-square is that of the rest with the whole reading noise in dark bins, too. Where it is much (kMuch), a fit of
// small shifts does not say how far light went: where the mean of all bins moved by more than kFarBins beyond what the
// reference's does from neighbour to neighbour, that is the deflection_shift.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "algo/frame/decode.h"
#include "algo/reference/pose.h"
#include "algo/reference/reference.h"
#include "algo/reference/reference_row_sampler.h"
#include "algo/reference/reference_sampler.h"
#include "algo/reference/template_fit.h"
#include "algo/simd/isa.h"

namespace hord::algo {

// Of one lenslet. Deviations in their units and their variance by noise alone.
struct Difference {
    bool has_light = false;  // the first two mean something: the reference knows how much light there should be
    bool has_hord = false;   // and so do the others
    float light = 0, light_variance = 1;  // light / expected - 1
    float x = 0, y = 0, x_variance = 1, y_variance = 1;
    float scattering = 0, blur_variance = 1;
    float chi2 = 0, degrees = 1;  // the rest, and what noise alone would give
    float sum = 0;                // DN
    std::uint32_t at = 0;         // the reference's nearest lenslet
};

constexpr float kMuch = 3;  // standard deviations
constexpr double kFarBins = 0.5;

class ReferenceComparer {
  public:
    // `reference` outlives it. Takes all memory. Comparers of one reference, one a thread, may share its planes; else
    // it makes its own.
    explicit ReferenceComparer(const Reference& reference, Isa isa = widest_isa(),
                               std::shared_ptr<const ReferenceSoa> planes = nullptr);

    // Compares row n of a part: `light` is its typical sum over the reference's. One Difference a lenslet.
    void compare_row(const HordRow& row, int n, const PoseMap& pose, double light, std::span<Difference> out);
    // The same from the frame that was decoded with the reference's light levels, when the lenslets' sums and masks are
    // known already. Those that are kOutside are not looked at: their Difference stays as it is.
    void compare_row(const FrameView& frame, std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask,
                     int n, const PoseMap& pose, double light, std::span<Difference> out);

  private:
    static constexpr int kLanes = kGoldenLanes;
    // Lenslets that lie between the same columns of the reference, lane l after column 16 block + l + 1, waiting to be
    // compared together.
    struct Group {
        int block = 0;
        std::uint32_t live = 0, with_hord = 0;  // bit l: lane l
        int last = -1;                          // lane
        PoseMap::Place at[kLanes];
        std::uint32_t sum[kLanes];
        Difference* out[kLanes];
        LensletSamples<std::uint8_t> narrow[kLanes];
        LensletSamples<std::uint16_t> wide[kLanes];
    };
    void start_row(const PoseMap& pose, int n, double light);
    int join(int m, int n, std::uint32_t sum, bool has_hord, Difference& out);
    template <class Sample>
    LensletSamples<Sample> copy_of(const LensletSamples<Sample>& samples, int lane);
    template <class Sample>
    void compare(LensletSamples<Sample> (&samples)[kLanes], std::uint32_t dark);
    bool look_at_light(int lane, double light, double share);
    void finish(int lane);
    void look_how_far(int lane, Difference& out) const;
    void find_edges();
    [[nodiscard]] BinNoise at_light(const BinNoise& noise) const;
    [[nodiscard]] std::uint32_t nearest(const PoseMap::Place& at) const;

    const Reference& reference_;
    std::shared_ptr<const ReferenceSoa> planes_;
    ReferenceRowSampler row_;
    ReferenceSampler reader_;  // where a row does not reach
    TemplateFitter fitter_;
    std::vector<std::uint8_t> edge_;     // one a lenslet: whether it is within two lenslets of an edge
    std::vector<float> read_;            // reference bins that a row does not reach, a Reference's stride a lane
    std::vector<std::uint16_t> copied_;  // samples of lenslets at the end of the frame's lines, lane by lane
    double clipped_ = 0;                 // of a typical lenslet's light, by the dark level
    double floor_ = 0;                   // variance of a reading
    BinNoise noise_{}, noise_at_edges_{};

    // Of the row at hand.
    const PoseMap* pose_ = nullptr;
    double light_ = 1, golden_share_ = 1;
    BinNoise noise_now_{}, noise_at_edges_now_{};
    Group group_;
    ReferenceRowSampler::Lanes reference_hords_;
    TemplateFitter::Fits fits_;
};

// The four scores of a lenslet: deviation over its standard deviation. Light and scattering are signed (less light,
// less spread: negative).
using Scores = std::array<float, kDeviations>;
Scores scores_of(const Difference& difference, const Reference& reference);

}  // namespace hord::algo
