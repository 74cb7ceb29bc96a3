// Compares the lenslets of a registered part with the reference HORDs at their places: change of light, shift of the
// mean deflection, scattering, and the remaining change of shape, each with its variance by noise.
//
// A fit of three templates (algo/reference/template_fit.h) separates shift and scattering; its rest is chi-square.
// Light is compared separately, at the part's typical light. Large shifts, and the variances: docs/notes/reference.md.
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

// One lenslet's deviations, in their units (enum Deviation), and their variances by noise alone.
struct Difference {
    bool has_light = false;               // light, sum and `at` are valid: the reference has light there
    bool has_hord = false;                // the others are valid
    float light = 0, light_variance = 1;  // light / expected - 1
    float x = 0, y = 0, x_variance = 1, y_variance = 1;
    float scattering = 0, scattering_variance = 1;
    float chi2 = 0, degrees = 1;  // of the rest; its expectation by noise alone
    float sum = 0;                // DN
    std::uint32_t at = 0;         // index of the reference's nearest lenslet
};

constexpr float kLargeRest = 3;  // standard deviations of sqrt(2 chi2)
constexpr double kLargeShiftBins = 0.5;

class ReferenceComparer {
  public:
    // `reference` outlives it. Allocates all memory. One comparer a thread; comparers of one reference may share its
    // SoA form, else each makes its own.
    explicit ReferenceComparer(const Reference& reference, Isa isa = widest_isa(),
                               std::shared_ptr<const ReferenceSoa> soa = nullptr);

    // Compares row n of a part, whose sums and masks were decoded with the reference's light levels, but `dark` as the
    // dark level: that of this frame, DN. `light`: the part's typical light over the reference's. Writes one Difference
    // a lenslet, but none of a kOutside one.
    void compare_row(const FrameView& frame, std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask,
                     int n, const PoseMap& pose, double light, std::uint32_t dark, std::span<Difference> out);

  private:
    static constexpr int kLanes = kReferenceLanes;
    // Lenslets that are compared together: lane l lies after column 16 block + l + 1 of the reference.
    struct Group {
        int block = 0;
        std::uint32_t live = 0, with_hord = 0;  // lanes in use, lanes with a HORD; bit l: lane l
        int last = -1;                          // the last lane in use
        PoseMap::Place at[kLanes];
        std::uint32_t sum[kLanes];
        Difference* out[kLanes];
        LensletSamples<std::uint8_t> narrow[kLanes];
        LensletSamples<std::uint16_t> wide[kLanes];
    };
    void start_row(const PoseMap& pose, int n, double light);
    int add_to_group(int m, int n, std::uint32_t sum, bool has_hord, Difference& out);
    template <class Sample>
    LensletSamples<Sample> copy_of(const LensletSamples<Sample>& samples, int lane);
    template <class Sample>
    void compare(LensletSamples<Sample> (&samples)[kLanes], std::uint32_t dark);
    bool compare_light(int lane, double light, double share);
    void finish(int lane);
    void measure_large_shift(int lane, Difference& out) const;
    [[nodiscard]] std::uint32_t nearest(const PoseMap::Place& at) const;

    const Reference& reference_;
    std::shared_ptr<const ReferenceSoa> soa_;
    ReferenceRowSampler row_sampler_;
    ReferenceSampler sampler_;  // for lenslets that row_sampler_ cannot interpolate
    TemplateFitter fitter_;
    std::vector<float> sampled_bins_;    // reference bins from sampler_, a Reference's stride a lane
    std::vector<std::uint16_t> copied_;  // samples of lenslets at the end of the frame's lines, lane by lane
    double clipped_ = 0;                 // light that the dark level removes, over the light that remains
    double floor_ = 0;                   // variance of a reading

    // Of the current row.
    const PoseMap* pose_ = nullptr;
    double light_ = 1, variance_factor_ = 1;
    Group group_;
    ReferenceRowSampler::Lanes reference_hords_;
    TemplateFitter::Fits fits_;
};

// The four z-scores of a lenslet: deviations over their standard deviations, noise and spread of good parts together.
// Light and scattering are signed (less light, less spread: negative).
using Scores = std::array<float, kDeviations>;
Scores scores_of(const Difference& difference, const Reference& reference);
// The share of noise in the variance of each score, 0..1. The rest is spread of good parts, by which neighbours deviate
// together.
Scores noise_shares(const Difference& difference, const Reference& reference);

}  // namespace hord::algo
