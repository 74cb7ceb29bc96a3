// How many good parts a limit rejects, at most: a bound with 95 % confidence from the worst scores of n distinct good
// parts (algo/good_parts/distinct_parts.h). Scores are in units of the limit: 1 and above is rejected.
//
// Two bounds. docs/notes/reference.md has the derivations.
//   any   Holds for any distribution: Clopper-Pearson. If none of n is rejected, 1 - 0.05^(1/n), about 3/n (rule of
//         three). It also holds if the limit was set from these scores, as long as the limit is above the highest.
//   tail  Holds if the worst scores, or their logarithms, follow a Gumbel distribution: each is the largest of many.
//         The larger of the two bounds, and at least 1/(50 n). None if the largest score lies too far away for both.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>

namespace hord::algo {

constexpr double kConfidence = 0.95;
constexpr double kGoalFalseRejects = 3e-3, kAimedFalseRejects = 1e-3;  // shares that reports compare with

// Upper bound of the share of all parts that are rejected, if `rejected` of `parts` are. 1 for no parts.
double most_rejected(std::size_t rejected, std::size_t parts);

// How many parts, `rejected` of them rejected, are needed until most_rejected() is at most `share` (above 0).
std::size_t parts_needed(std::size_t rejected, double share);

struct FalseRejects {
    std::size_t parts = 0, rejected = 0;
    double any = 1;              // bound for any distribution, 0..1
    std::optional<double> tail;  // bound if the scores, or their logarithms, follow a Gumbel distribution
    // What may be promised: the bound without an assumption.
    [[nodiscard]] double bound() const { return any; }
};

// The tail needs this many parts.
constexpr std::size_t kMinTailParts = 8;

// At the limit `limit` of the scores of parts, all above 0. `distinct`: so many of them are distinct at least
// (DistinctParts::Groups::at_least); left out, all are.
FalseRejects false_rejects_at(std::span<const double> scores, double limit, std::optional<std::size_t> distinct = {});

// The least limit at which the tail bound is at most `share`, and which is above the highest score.
double limit_for(std::span<const double> scores, double share);

// The limit, above the highest score, that a share `share` of further parts exceeds in the mean over all sets of as
// many parts as gave `scores`, if these or their logarithms follow a Gumbel distribution, whichever gives the higher
// limit. The error of the estimate is part of it: 60 parts need 5.4 standard deviations for 0.1 %, an estimate without
// error 4.9 (docs/adr/0017-limits-from-few-parts.md).
double predicted_limit(std::span<const double> scores, double share);
// The same if the scores themselves follow a Gumbel distribution: of scores that are over the spread of their own frame
// (algo/reference/pooled_scores.h), which have no heavier tail (docs/adr/0019-scores-of-several-lenslets.md).
double predicted_light_tailed_limit(std::span<const double> scores, double share);

// One to three sentences for people: the bound, what it assumes, and how many more parts would prove 0.3 % and 0.1 %
// without the assumption.
std::string describe(const FalseRejects& rejects);

}  // namespace hord::algo
