// How well each feature separates defects from good patches at one point of the trade-off.
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

// Scores are the largest values in patches of 3x3 used lenslets: around each defect, and in twenty disjoint patches of
// each good part. Lenslets without a value count 0. The value of the transmission is its distance from 1.
//
// One object a feature in the answer, by name:
//   {"bubble": {"auc", "tpr": [value, low, high], "a50", "a90", "a90_95": size or null, "b0", "b1"}, "inclusion" and
//   "haze": the same,
//    "threshold", "error": root mean square difference from the value of the noise-free light over good patches'
//    lenslets, "flips": share of defects whose verdict at the threshold differs from that with noise-free light}
Result<Json> score_features(const TradeoffParts& parts, const TradeoffPoint& point, const ScoreOptions& options);

}  // namespace hord::lab
