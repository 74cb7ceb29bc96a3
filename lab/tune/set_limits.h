// The limits of a feature set, from the good parts alone, and what all parts score at them (lab/tune/tune.h).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "lab/report/statistics.h"
#include "lab/tune/measured_part.h"
#include "lab/tune/tune.h"

namespace hord::lab {

constexpr int kBootstraps = 1000;
constexpr std::uint64_t kBootstrapSeed = 1;

// `parts`: numbered; `good_at_least`: of them certainly distinct good ones (algo::DistinctParts::Groups::at_least).
// All of it must outlive the LimitSetter.
class LimitSetter {
  public:
    LimitSetter(const TuneOptions& options, std::span<const MeasuredPart> parts, std::size_t good_at_least);

    // Sets the recipe with limits, or the reason why there are no limits; then the counts, the false rejects and the
    // AUC at the limits. `reference_index`: the set's place among those with a reference. The scores: each part once.
    std::vector<ScoredPlace> set(MeasuredFeatureSet& measured, std::size_t reference_index) const;

  private:
    // What the scores of a set with a reference are divided by. Pooled 0: not judged together.
    struct Factors {
        double by_lenslets = 1, pooled = 0;
    };
    Factors set_reference_limits(MeasuredFeatureSet& measured, std::size_t reference_index) const;
    void set_value_limits(MeasuredFeatureSet& measured) const;
    [[nodiscard]] double score_of(const MeasuredPart& part, const FeatureSet& set, const Factors& factors,
                                  std::size_t reference_index) const;
    std::vector<ScoredPlace> count(MeasuredFeatureSet& measured, std::span<const double> scores) const;

    const TuneOptions& options_;
    std::span<const MeasuredPart> parts_;
    std::size_t good_at_least_;
    FeatureValues limits_{};  // of the sets without a reference
};

}  // namespace hord::lab
