// How well one feature tells good patches from defects at one point of the trade-off.
#pragma once

#include <vector>

#include "algo/features/feature.h"
#include "lab/experiment/result_cache.h"
#include "lab/report/statistics.h"
#include "lab/tradeoff/tradeoff_parts.h"

namespace hord::lab {

// Every feature of algo: the distances over neighbours and against a reference, the Jacobian's norms, the transmission.
std::vector<algo::FeatureChoice> every_choice();

struct ScoreOptions {
    int good_exposures = 8, bad_exposures = 2;  // of every part
    int repeats = 200;                          // of the bootstrap
    std::uint64_t seed = 1;
    int threads = 0;  // 0: one a core
};
constexpr double kFalsePositives = 1e-3;

// A place is a patch of 3x3 used lenslets, its score the largest value in it: of the lenslets around a defect's, or of
// one of twenty disjoint patches of a good part. Lenslets without a value count 0. For the transmission, a value is how
// far it is from 1.
//
// One object a feature in the answer, by name:
//   {"bubble": {"auc", "tpr": [value, low, high], "a50", "a90", "a90_95": size or null, "b0", "b1"}, "inclusion" and
//   "haze": the same,
//    "threshold", "error": root mean square difference from the value of the noise-free light over good patches'
//    lenslets, "flips": share of defects whose verdict at the threshold is another than with noise-free light}
Result<Json> score_features(const TradeoffParts& parts, const TradeoffPoint& point, const ScoreOptions& options);

}  // namespace hord::lab
