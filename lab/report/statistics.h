// Statistics of detection: ROC, probability of detection, limits, with confidence intervals.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "algo/good_parts/pod_curve.h"
#include "common/statistics.h"

namespace hord::lab {

// A number with its 95 % confidence interval.
struct Estimate {
    double value = 0, low = 0, high = 0;
};

// A scored place. Places of one part are not independent, so bootstraps draw parts.
struct ScoredPlace {
    float score = 0;
    std::uint32_t part = 0;
    bool bad = false;
};

struct Detection {
    Estimate auc;         // area under the ROC curve: 0.5 is chance, 1 is perfect
    Estimate tpr;         // true positives at the largest threshold that keeps the false positives at or below `fpr`
    float threshold = 0;  // that threshold: a score above it counts
};

// Intervals by the percentile bootstrap over parts (`repeats` draws from `seed`). Ties count half in the area; a
// threshold never cuts through them. Needs at least one good and one bad score; else everything is 0.
Detection detection_of(std::span<const ScoredPlace> scores, double fpr, int repeats, std::uint64_t seed);

// AUC by the scores `a` less AUC by `b`: paired, of the same places in the same order, drawn together.
Estimate auc_difference(std::span<const ScoredPlace> a, std::span<const ScoredPlace> b, int repeats,
                        std::uint64_t seed);

// The score that a share of good parts exceeds if their scores follow a Gumbel distribution (each is the largest of
// many), fitted by moments; at least the largest score. 0 for none. For tens of parts; for hundreds use tail_limit().
double gumbel_limit(std::span<const double> good, double share);

// The limit of three digits that a recipe gets for parts that reach `value`: above it, so that they pass, also in the
// single precision of the station and as 1 - limit (transmission). 0 for none.
double limit_above(double value);

using algo::DetectionTrial, algo::PodCurve, algo::pod_curve;
using common::quantile;

// The value that a share `above` of all parts exceed, where `values` are those of some of them: peaks over a threshold.
// The largest tenth of the values (ten at least), less the smallest of them, are taken as generalised Pareto, fitted by
// probability-weighted moments (Hosking & Wallis, Technometrics 29 (1987) 339). A tail that ends (a negative shape) is
// taken as exponential. Never below the largest value. 0 for none.
double tail_limit(std::vector<double> values, double above);

}  // namespace hord::lab
