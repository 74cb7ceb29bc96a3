// One seed of one family: what is learned and told as `hordctl learn` does, and the scores of further parts, good and
// with flaws.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/result.h"
#include "lab/guarantee/drawn_families.h"

namespace hord::lab {

constexpr double kTuneShare = 1e-3;  // of good parts that the tuned limits should reject: the default of `tune`
constexpr int kLearnedParts = 24, kTunedParts = 60, kTunedAgain = 15;  // parts; of those to tune on exposed twice

// Scores are over limits: 1 and above is rejected. A part that is unfit, or in which the reference is not found, has
// ReferenceCheck::kUnfit.
struct JudgedFamily {
    double learn_bound = 1;              // of false rejects, as `learn` tells it for the recipe that a user gets
    std::size_t counted = 0;             // distinct parts that were found among the frames to tune on
    std::vector<double> to_tune;         // worst score of each distinct part to tune on, over the tuned limits
    double limit = 1, pooled_limit = 1;  // as `tune` sets them with kTuneShare: times the recipe's; pooled_score
    double tune_bound = 1;               // of false rejects, as `tune` tells it for that limit
    std::vector<double> by_recipe;       // scores of the good parts to test, over the recipe's limits
    std::vector<double> by_tuned;        // and over the tuned ones
    struct Flawed {
        double size = 0, score = 0;  // over the tuned limits
    };
    std::array<std::vector<Flawed>, kDrawnFlaws.size()> flawed;
};

// `good` parts to test, and `flawed` of each flaw.
Result<JudgedFamily> judge_family(std::size_t family, std::uint64_t seed, int good, int flawed);

}  // namespace hord::lab
