#include "lab/tune/set_limits.h"

#include <algorithm>
#include <map>

#include <fmt/format.h>

#include "algo/good_parts/false_rejects.h"
#include "firmware/recipes/recipe_file.h"

namespace hord::lab {

namespace {

// The limit: what is predicted for the share of false rejects, and above every good part. All above 0.
double limit_of(const std::vector<double>& good, double predicted) {
    return std::max(1e-3, limit_above(std::max(predicted, (1 + kMargin) * *std::ranges::max_element(good))));
}

void scale(float& limit, double factor) { limit = static_cast<float>(static_cast<double>(limit) * factor); }

}  // namespace

LimitSetter::LimitSetter(const TuneOptions& options, std::span<const MeasuredPart> parts, std::size_t good_at_least)
    : options_(options), parts_(parts), good_at_least_(good_at_least) {
    for (std::size_t v = 0; v < kValues; ++v) {
        const auto good = worst_of_good(parts, [&](const MeasuredPart& part) { return std::optional(part.values[v]); });
        limits_[v] = limit_of(good, gumbel_limit(good, options.false_rejects));
    }
}

std::vector<ScoredPlace> LimitSetter::set(MeasuredFeatureSet& measured, std::size_t reference_index) const {
    measured.recipe = options_.base;
    measured.recipe.recipe = recipe_of(measured.set, options_.base.recipe);
    Factors factors;
    if (measured.set.reference) factors = set_reference_limits(measured, reference_index);
    else set_value_limits(measured);
    if (measured.no_limit.empty()) {
        if (auto readable = firmware::parse_numbered_recipe(format_recipe(measured.recipe), "limit"); !readable)
            measured.no_limit = readable.error().what;
    }
    std::vector<double> scores;
    for (const MeasuredPart& part : parts_) scores.push_back(score_of(part, measured.set, factors, reference_index));
    return count(measured, scores);
}

// One factor for all limits of lenslets, and pooled_score: each for half of the false rejects.
LimitSetter::Factors LimitSetter::set_reference_limits(MeasuredFeatureSet& measured,
                                                       std::size_t reference_index) const {
    algo::Recipe& recipe = measured.recipe.recipe;
    Factors factors;
    const auto good_scores = [&](std::vector<double> MeasuredPart::*of) {
        return worst_of_good(parts_, [&](const MeasuredPart& part) {
            return part.registered[reference_index] ? std::optional((part.*of)[reference_index]) : std::nullopt;
        });
    };
    const auto found = static_cast<std::size_t>(std::ranges::count_if(
        parts_, [&](const MeasuredPart& part) { return !part.bad && part.registered[reference_index]; }));
    if (found < kMinGood) {
        measured.no_limit = fmt::format("the reference finds only {} of the good parts", found);
    } else {
        const double share = options_.false_rejects / 2;
        const auto by_lenslets = good_scores(&MeasuredPart::by_lenslets);
        factors.by_lenslets = limit_of(by_lenslets, algo::predicted_limit(by_lenslets, share));
        if (!recipe.reference->pooled_scales.empty()) {
            const auto together = good_scores(&MeasuredPart::together);
            factors.pooled = std::clamp(limit_of(together, algo::predicted_light_tailed_limit(together, share)), 1.0,
                                        static_cast<double>(algo::kPooledUnreached));
        }
    }
    algo::scale_score_limits(recipe, factors.by_lenslets);
    recipe.pooled_score = static_cast<float>(factors.pooled);
    if (measured.set.gradient) scale(recipe.emd_limit_bins, factors.by_lenslets);
    if (measured.set.slopes) scale(recipe.frobenius_limit_bins, factors.by_lenslets);
    return factors;
}

// The limit of each feature of a set without a reference.
void LimitSetter::set_value_limits(MeasuredFeatureSet& measured) const {
    const FeatureSet& set = measured.set;
    algo::Recipe& recipe = measured.recipe.recipe;
    measured.recipe.reference_file.clear();
    if (set.gradient)
        (*set.gradient == algo::Feature::emd ? recipe.emd_limit_bins : recipe.gradient_limit) =
            static_cast<float>(limits_[index_of(*set.gradient)]);
    if (set.slopes) recipe.frobenius_limit_bins = static_cast<float>(limits_[kSlopes]);
    if (!set.light) return;
    recipe.transmission_limit = static_cast<float>(std::max(0.0, 1 - limits_[kLight]));
    if (limits_[kLight] >= 0.999)
        measured.no_limit =
            "good parts have places without light, or nearly: no limit of the transmission lets them pass";
}

// 1 and above is rejected.
double LimitSetter::score_of(const MeasuredPart& part, const FeatureSet& set, const Factors& factors,
                             std::size_t reference_index) const {
    double score = 0;
    if (set.reference) {
        score = part.by_lenslets[reference_index] / factors.by_lenslets;
        if (factors.pooled > 0) score = std::max(score, part.together[reference_index] / factors.pooled);
        return score;
    }
    if (set.gradient) score = part.values[index_of(*set.gradient)] / limits_[index_of(*set.gradient)];
    if (set.slopes) score = std::max(score, part.values[kSlopes] / limits_[kSlopes]);
    if (set.light) score = std::max(score, part.values[kLight] / limits_[kLight]);
    return score;
}

// Each part counts once: a good one with its worst frame, a bad one with the frame that is hardest to find.
std::vector<ScoredPlace> LimitSetter::count(MeasuredFeatureSet& measured, std::span<const double> scores) const {
    std::map<std::uint32_t, ScoredPlace> of_parts;
    std::vector<float> rounded;
    for (std::size_t k = 0; k < parts_.size(); ++k) {
        const MeasuredPart& part = parts_[k];
        if (scores[k] >= 1) ++(part.bad ? measured.found : measured.rejected);
        const auto value = static_cast<float>(scores[k]);
        rounded.push_back(value);
        const auto [at, is_new] = of_parts.try_emplace(part.number, ScoredPlace{value, part.number, part.bad});
        if (!is_new)
            at->second.score = part.bad ? std::min(at->second.score, value) : std::max(at->second.score, value);
    }
    const auto score_of_good = [&](const MeasuredPart& part) {
        return std::optional(static_cast<double>(rounded[static_cast<std::size_t>(&part - parts_.data())]));
    };
    measured.false_rejects = algo::false_rejects_at(worst_of_good(parts_, score_of_good), 1, good_at_least_);
    std::vector<ScoredPlace> scored;
    for (const auto& [number, place] : of_parts) scored.push_back(place);
    measured.auc = detection_of(scored, 0, kBootstraps, kBootstrapSeed).auc;
    return scored;
}

}  // namespace hord::lab
