#include "lab/tune/measured_part.h"

#include <algorithm>

namespace hord::lab {

std::size_t index_of(algo::Feature gradient) {
    return static_cast<std::size_t>(std::ranges::find(algo::kJudgedGradients, gradient) -
                                    algo::kJudgedGradients.begin());
}

algo::Recipe recipe_of(const FeatureSet& set, const algo::Recipe& base) {
    const algo::Recipe defaults;
    algo::Recipe recipe = base;
    recipe.gradient = set.gradient;
    recipe.slopes = set.slopes;
    recipe.light = set.light;
    recipe.gradient_limit = set.gradient && *set.gradient != algo::Feature::emd ? 1.0F : 0.0F;
    if (set.gradient != algo::Feature::emd || !set.reference) recipe.emd_limit_bins = defaults.emd_limit_bins;
    if (!set.slopes || !set.reference) recipe.frobenius_limit_bins = defaults.frobenius_limit_bins;
    recipe.transmission_limit = defaults.transmission_limit;
    if (set.reference) recipe.pooled_score = algo::kPooledUnreached;
    if (!set.reference) {
        recipe.reference.reset();
        recipe.tolerances.clear();
        recipe.reject_score = defaults.reject_score, recipe.grow_score = defaults.grow_score,
        recipe.cluster_score = defaults.cluster_score, recipe.pooled_score = defaults.pooled_score;
    }
    return recipe;
}

}  // namespace hord::lab
