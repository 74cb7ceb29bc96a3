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

// Probability of detection by radius, of the bubbles at least `from_rim` lenslets from the rim. Uses only the first of
// the `exposures` of each bubble: the curve's bound holds for independent trials.
PodCurve pod_of(const Parts& bubbles, int exposures, double from_rim);

}  // namespace hord::lab
