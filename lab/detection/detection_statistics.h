// Statistics over the judged parts of the detection experiment's figures.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "lab/detection/detection.h"

namespace hord::lab {

using Parts = std::vector<JudgedPart>;

// A figure's parts; empty for a figure that has none.
const Parts& parts_of(const DetectionResults& results, std::string_view figure);
bool is_finished(const DetectionResults& results, const std::string& figure);

// The share of the parts whose score is at least `limit`; 0 for no parts.
double share_above(const Parts& parts, double limit);

// The share k of n with its Wilson interval. For 0 of n the upper bound is about 3.8 / n.
Estimate share_of(double k, double n);

// At the limit at which `from` rejects one part in twenty: the rejected share of `of` over that of `from`. The
// interval is a percentile bootstrap over the parts of both.
Estimate ratio_of_rejects(const Parts& from, const Parts& of, std::uint64_t seed);

// ROC of bad against good parts. The bootstrap draws poses with all their exposures; 0 poses: every part has its own.
Detection roc_of(const Parts& good, const Parts& bad, int good_poses, int bad_poses, std::uint64_t seed);

// The contrast of the cut at one place between the lenslets, with one seed, in clean standard deviations.
struct PlaceContrast {
    double m = 0, n = 0;  // right of and below a lenslet's middle, lenslets
    std::uint64_t seed = 1;
    double emd = 0, score = 0, surest = 0;  // the EMD gradient; the score; the surest possible score
};

// The contrast claim: at every place and with every seed the score is at least kOfSurest of the surest possible, and at
// least kOverEmd times the EMD gradient wherever the surest possible is. EMD gradients below one sigma count as one.
constexpr double kOfSurest = 0.9, kOverEmd = 2;
struct ContrastClaim {
    struct Spread {
        double least = 0, median = 0, most = 0;
    };
    Spread of_surest, over_emd;  // score / surest possible, score / EMD gradient, over all places and seeds
    std::vector<PlaceContrast> below_surest, below_emd;  // where each half of the claim does not hold
    std::size_t beyond_reach = 0;  // places where the surest possible is below kOverEmd times the EMD gradient
    double least_surest_over_emd = 0;
    [[nodiscard]] bool holds() const { return below_surest.empty() && below_emd.empty(); }
};
ContrastClaim contrast_claim(const std::vector<PlaceContrast>& places);

// Probability of detection by radius, of the bubbles at least `from_rim` lenslets from the rim. Uses only the first of
// the `exposures` of each bubble: the curve's bound holds for independent trials.
PodCurve pod_of(const Parts& bubbles, int exposures, double from_rim);

}  // namespace hord::lab
